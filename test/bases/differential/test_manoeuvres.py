"""Manoeuvres: velocities that the limits allow, which lead from start to goal; openings; states."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import PIONEER

from ator_ros.bases.differential.durations import rates_of
from ator_ros.bases.differential.manoeuvre import (
    SIDE,
    SPEED_PIECES,
    TURN_PIECES,
    Manoeuvre,
    Side,
    close,
    is_forward,
    pose_after_turn,
    write_pieces,
)
from ator_ros.bases.differential.paths import entries_of, exits_of, find_paths
from ator_ros.bases.differential.trajectory import (
    DT,
    Trajectory,
    most_states,
    opening_of,
    write_states,
)
from ator_ros.geometry import FloatArray, Pose, Record
from ator_ros.world.state import RobotState

LIMITS = PIONEER.limits
RATES = rates_of(LIMITS)
START = Pose(0.5, -1.0, 2.0)
GOAL = Pose(2.5, 0.4, -1.0)


def record(side: Side) -> Record:
    return np.array([side], dtype=SIDE)[0]


def straight_on(rate: float = LIMITS.w) -> Side:
    """Return a side without a straight part, from rest."""
    return Side(0.0, 0.0, 0.0, 0.0, rate)


ENTRY = Side(0.3, 0.2, 0.4, -0.1, 0.8)
EXIT = Side(0.4, 0.1, 0.3, 0.2, 0.6)


def pieces(
    first: float, last: float, drive: float, entry: Side, exit_: Side
) -> tuple[FloatArray, FloatArray, float]:
    speeds = np.empty((SPEED_PIECES, 3))
    turns = np.empty((TURN_PIECES, 3))
    time = write_pieces(speeds, turns, first, last, drive, record(entry), record(exit_), RATES)
    return speeds, turns, time


def closed() -> tuple[float, float, float]:
    """Return the turns and the drive of the fastest manoeuvre between start and goal."""
    paths = find_paths(START, GOAL, entries_of([ENTRY], LIMITS), exits_of([EXIT], LIMITS), LIMITS)
    first, last = float(paths[0]["first"]), float(paths[0]["last"])
    first, last, drive, met = close(first, last, START, GOAL, record(ENTRY), record(EXIT), RATES)
    assert met
    return first, last, drive


def joined(values: FloatArray) -> FloatArray:
    """Return the pieces that take time."""
    return values[values[:, 0] > 1e-12]


def covered(values: FloatArray) -> float:
    """Return the integral over linear pieces."""
    return float((values[:, 0] * (values[:, 1] + values[:, 2]) / 2.0).sum())


@settings(max_examples=60, deadline=None)
@given(
    first=st.floats(-4.0, 4.0),
    last=st.floats(-4.0, 4.0),
    drive=st.floats(-3.0, 3.0),
    outer=st.floats(0.0, 0.6),
    speed=st.floats(0.0, 0.6),
    change=st.floats(-0.3, 0.3),
)
def test_velocities_are_continuous_within_limits_and_turn_by_both_angles(
    first: float, last: float, drive: float, outer: float, speed: float, change: float
) -> None:
    entry = Side(0.5, outer, speed, change, 0.7 * LIMITS.w)
    exit_ = Side(0.4, 0.1, 0.3, -change, LIMITS.w)
    speeds, turns, time = pieces(first, last, drive, entry, exit_)
    for values, greatest, acceleration in (
        (speeds, LIMITS.v, max(LIMITS.a, LIMITS.brake)),
        (turns, LIMITS.w, LIMITS.aw),
    ):
        assert (values[:, 0] >= -1e-9).all()
        assert values[:, 0].sum() == pytest.approx(time)
        assert np.abs(values[:, 1:]).max() <= greatest + 1e-9
        for before, after in pairwise(joined(values)):
            assert before[2] == pytest.approx(after[1], abs=1e-6)
        for duration, begin, end in joined(values):
            assert abs(end - begin) <= acceleration * duration + 1e-6
    assert covered(turns[1:4]) == pytest.approx(first, abs=1e-6)
    assert covered(turns[5:8]) == pytest.approx(last, abs=1e-6)
    assert np.abs(turns[1:4, 1:]).max(initial=0.0) <= 0.7 * LIMITS.w + 1e-9
    assert covered(speeds[:3]) == pytest.approx(entry.length, abs=1e-6)
    assert covered(speeds[5:8]) == pytest.approx(drive, abs=1e-6)
    assert covered(speeds[10:13]) == pytest.approx(exit_.length, abs=1e-6)
    assert (speeds[0, 1], speeds[12, 2]) == (entry.outer_speed, exit_.outer_speed)


def test_speed_changes_in_a_turn_until_the_limit_and_backward_in_time_in_the_last_one() -> None:
    rising = Side(0.0, 0.5, 0.5, 0.4, 1.0)
    speeds, turns, _ = pieces(3.0, 0.0, 0.0, rising, straight_on())
    duration = turns[1:4, 0].sum()
    until_limit = (LIMITS.v - 0.5) / 0.4
    assert speeds[3].tolist() == pytest.approx([until_limit, 0.5, LIMITS.v])
    assert speeds[4].tolist() == pytest.approx([duration - until_limit, LIMITS.v, LIMITS.v])
    falling = Side(0.0, -0.5, -0.5, -0.4, 1.0)
    speeds, _, _ = pieces(3.0, 0.0, 0.0, falling, straight_on())
    assert speeds[4, 1] == pytest.approx(-LIMITS.v)
    speeds, turns, _ = pieces(0.0, 1.0, 0.0, straight_on(), Side(0.0, 0.2, 0.2, 0.1, 1.0))
    assert speeds[9, 2] == pytest.approx(0.2)
    assert speeds[9, 1] == pytest.approx(0.2 + 0.1 * turns[5:8, 0].sum())


def test_a_pose_after_a_turn_is_that_of_the_driven_manoeuvre() -> None:
    for first in (-2.5, -0.4, 0.9, 3.0):
        end = pose_after_turn(START, first, record(ENTRY), RATES)
        speeds, turns, _ = pieces(first, 0.0, 0.0, ENTRY, straight_on())
        states = np.empty((100_000, 5))
        until = speeds[:5, 0].sum()
        count = write_states(
            states, speeds[:5], turns[:4], until, START, Pose(math.nan, 0.0, 0.0), 0.001
        )
        assert count == len(np.arange(0.0, until, 0.001)) + 1
        assert end.yaw == pytest.approx(START.yaw + first)
        # without its correction at the goal: steps of a trapezoid
        x, y, yaw = START
        for at in range(1, count):
            dt = min(0.001, until - 0.001 * (at - 1))
            v, w = 0.5 * (states[at - 1, 3:] + states[at, 3:])
            x += v * dt * math.cos(yaw + 0.5 * w * dt)
            y += v * dt * math.sin(yaw + 0.5 * w * dt)
            yaw += w * dt
        assert (x, y) == pytest.approx((end.x, end.y), abs=2e-3)


def test_a_closed_manoeuvre_meets_its_goal_and_an_impossible_one_is_not_closed() -> None:
    first, last, drive = closed()
    turned = Pose(0.0, 0.0, START.yaw + first + last).relative(Pose(0.0, 0.0, GOAL.yaw)).yaw
    assert turned == pytest.approx(0.0, abs=1e-9)
    after = pose_after_turn(START, first, record(ENTRY), RATES)
    before = pose_after_turn(GOAL._replace(yaw=GOAL.yaw + math.pi), -last, record(EXIT), RATES)
    driven = after.ahead(drive)
    assert (driven.x, driven.y) == pytest.approx((before.x, before.y), abs=1e-6)
    nowhere = Pose(math.nan, 0.0, 0.0)
    assert not close(first, last, START, nowhere, record(ENTRY), record(EXIT), RATES)[3]


def test_a_manoeuvre_takes_the_sum_of_its_pieces_and_its_trajectory_ends_at_the_goal() -> None:
    first, last, drive = closed()
    plan = Manoeuvre(START, GOAL, ENTRY, EXIT, first, last, drive, LIMITS)
    _, turns, duration = plan.pieces()
    assert plan.duration == duration == pytest.approx(turns[:, 0].sum())
    trajectory = Trajectory(plan)
    assert trajectory.duration == pytest.approx(duration)
    assert trajectory.at(0.0).pose == START
    end = trajectory.at(duration + 5.0)
    assert end.pose.distance(GOAL) < 1e-9
    assert (end.vx, end.w) == pytest.approx((EXIT.outer_speed, 0.0))
    poses = trajectory.poses()
    assert poses.shape == (math.ceil(duration / DT) + 1, 3)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert steps.max() <= LIMITS.v * DT * 1.01
    middle = trajectory.at(0.5 * duration)
    around = [trajectory.at(0.5 * duration + dt).pose for dt in (-DT, DT)]
    along = math.hypot(around[1].x - around[0].x, around[1].y - around[0].y)
    assert along == pytest.approx(abs(middle.vx) * 2.0 * DT, rel=0.02)


def test_states_of_an_open_motion_are_bent_to_the_goal_little_by_little() -> None:
    speeds = np.array([[2.0, 0.5, 0.5]])
    turns = np.array([[2.0, 0.0, 0.0]])
    states = np.empty((most_states(2.0, 0.5), 5))
    goal = Pose(1.2, 0.4, 0.2)
    count = write_states(states, speeds, turns, 2.0, Pose(0.0, 0.0, 0.0), goal, 0.5)
    assert count == 5
    expected = [[0.3 * at, 0.1 * at, 0.05 * at, 0.5, 0.0] for at in range(5)]
    assert states[:count] == pytest.approx(np.array(expected))


def test_forward_manoeuvres_have_no_backward_piece_and_room_for_their_change_of_speed() -> None:
    def forward(drive: float, entry: Side, exit_: Side) -> bool:
        speeds, _, _ = pieces(0.5, 0.5, drive, entry, exit_)
        return is_forward(speeds, drive, RATES)

    slow, fast = Side(0.0, 0.0, 0.0, 0.0, 1.0), Side(0.0, 0.6, 0.6, 0.0, 1.0)
    needed = 0.5 * 0.6**2 / min(LIMITS.a, LIMITS.brake)
    assert forward(1.0, slow, slow)
    assert not forward(-1.0, slow, slow)
    assert forward(needed + 0.1, slow, fast)
    assert forward(needed + 0.1, fast, slow)
    assert not forward(0.1 * needed, fast, slow)
    assert not forward(1.0, Side(0.0, -0.1, -0.1, 0.0, 1.0), slow)


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize(("v", "w"), [(0.5, 1.0), (0.4, -0.8), (0.0, 0.5), (0.6, 0.0)])
def test_an_opening_stops_the_turn_as_fast_as_the_limits_allow(
    stops: bool, v: float, w: float
) -> None:
    start = RobotState(Pose(1.0, 2.0, 0.7), v, w)
    opening = opening_of(start, LIMITS, stops=stops)
    assert opening.end.w == 0.0
    assert opening.end.vx == (0.0 if stops else v)
    needed = abs(w) / LIMITS.aw
    assert opening.duration == pytest.approx(max(needed, v / LIMITS.brake if stops else 0.0))
    x, y, yaw = start.pose
    steps = 5000
    for at in range(steps):
        share = (at + 0.5) / steps
        dt = opening.duration / steps
        rate = w * (1.0 - share)
        speed = v + share * (opening.end.vx - v)
        x += speed * dt * math.cos(yaw + 0.5 * rate * dt)
        y += speed * dt * math.sin(yaw + 0.5 * rate * dt)
        yaw += rate * dt
    end = opening.end.pose
    assert (end.x, end.y, end.yaw) == pytest.approx((x, y, yaw), abs=2e-3)
    trajectory = Trajectory(None, opening)
    assert trajectory.duration == opening.duration
    assert trajectory.at(0.0).w == pytest.approx(w)
