"""Estimates of running drives: exact where the prediction is, and corrected by what is left."""

import itertools
import math

import numpy as np
import pytest

from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.learning.estimates import (
    BY_DRIVES,
    BY_LIMITS,
    DriveEstimator,
    ObservedDrives,
    Pace,
    drive_estimator,
    time_at_limits,
)
from ator_ros.world.state import RobotState

ROBOT = find_domain("pursuit").robot()
LENGTH, SPEED, TURN = 8.0, 0.5, 3.0
AT_REST = RobotState(Pose(0.0, 0.0, 0.0))
PACE = Pace(0.5, 0.1, 0.1)
PATH = np.stack([np.linspace(0.0, LENGTH, 81), np.zeros(81)], axis=1)
"""A straight path along x; the robot turns for 3 s at its end."""


def estimator(total: float = LENGTH / SPEED + TURN) -> DriveEstimator:
    pace = Pace(SPEED, 0.0, 0.0)
    return DriveEstimator(
        total, 0.5, total + 1.0, "model", pace, 1.5 / TURN, total - LENGTH / SPEED, goal_yaw=1.5
    )


def place_at(time: float, waits: float = 0.0, since: float = 0.0) -> Pose:
    """Return where the robot is that waits from `since` on for a time."""
    driven = time - min(max(0.0, time - since), waits)
    x = min(LENGTH, SPEED * driven)
    turned = max(0.0, driven - LENGTH / SPEED) / TURN
    return Pose(x, 0.0, 1.5 * min(1.0, turned))


def totals(found: DriveEstimator, duration: float, **waiting: float) -> np.ndarray:
    times = np.arange(0.0, duration, 0.5)
    return np.array([found.estimate(t, place_at(t, **waiting), PATH).total for t in times])


def test_a_drive_that_goes_as_predicted_keeps_its_estimate() -> None:
    found = totals(estimator(), 19.0)
    assert found == pytest.approx(19.0, abs=0.05)


def test_a_robot_that_waits_is_late_by_no_more_and_no_less() -> None:
    found = totals(estimator(), 24.0, waits=5.0, since=6.0)
    assert found[0] == pytest.approx(19.0)
    assert found[-1] == pytest.approx(24.0, abs=0.1)
    assert (np.diff(found) >= -0.05).all()


def test_an_estimate_moves_by_no_more_than_its_error() -> None:
    for predicted in (17.0, 18.0, 19.0, 21.0):
        found = totals(estimator(predicted), 19.0)
        errors = np.abs(found - 19.0)
        moves = np.abs(np.diff(found))
        assert (moves <= errors[:-1] + 0.05).all()


@pytest.mark.parametrize("predicted", [12.0, 16.0, 18.0, 20.0, 24.0])
def test_nor_does_that_of_a_server_that_ends_drives_short_of_the_goal(predicted: float) -> None:
    short, ends_within_angle = 0.2, 0.3
    found = estimator(predicted)
    found.pace = Pace(SPEED, short, ends_within_angle)
    duration = (LENGTH - short) / SPEED + (1.5 - ends_within_angle) * TURN / 1.5
    times = np.arange(0.0, duration, 0.5)
    turned = np.clip((times - (LENGTH - short) / SPEED) / TURN * 1.5, 0.0, None)
    estimated = [
        found.estimate(time, Pose(min(SPEED * time, LENGTH - short), 0.0, yaw), PATH).total
        for time, yaw in zip(times.tolist(), turned.tolist(), strict=True)
    ]
    errors = np.abs(np.array(estimated) - duration)
    moves = np.abs(np.diff(estimated))
    assert (moves <= errors[:-1] + 1e-6).all()


def test_a_longer_path_takes_longer_by_its_length() -> None:
    found = estimator()
    before = found.estimate(4.0, Pose(2.0, 0.0, 0.0), PATH)
    assert before.total == pytest.approx(19.0)
    around = np.array([(2.0, 0.0), (2.0, 3.0), (7.0, 3.0), (7.0, 0.0), (8.0, 0.0)])
    after = found.estimate(4.5, Pose(2.0, 0.0, 0.0), around)
    assert after.total - before.total == pytest.approx(6.0 / SPEED + 0.5)


def test_the_rest_of_a_path_that_crosses_itself_is_not_cut() -> None:
    loop = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 4.0), (2.0, -4.0)])
    fine = np.concatenate([np.linspace(*ends, 41)[:-1] for ends in itertools.pairwise(loop)])
    found = DriveEstimator(
        0.0, 0.5, 1.0, "model", Pace(1.0, 0.0, 0.0), 1.0, 100.0, goal_yaw=-math.pi / 2.0
    )
    for x in np.arange(0.0, 2.6, 0.5):
        rest = found.estimate(0.0, Pose(x, 0.0, 0.0), fine).remaining
    assert rest == pytest.approx(18.0 - 2.5, abs=0.5)


def start(observed: ObservedDrives) -> DriveEstimator:
    return drive_estimator(
        ROBOT, AT_REST, Pose(LENGTH, 0.0, 0.0), PATH,
        model=None, observed=observed,
    )  # fmt: skip


def test_without_a_model_it_is_the_time_at_the_limits_as_late_as_former_drives() -> None:
    observed = ObservedDrives()
    first = start(observed)
    gaining = ROBOT.greatest_speed() / (2.0 * min(axis.rate for axis in ROBOT.axes[:1]))
    assert first.total == pytest.approx(LENGTH / ROBOT.greatest_speed() + 2.0 * gaining, rel=0.05)
    assert first.basis == BY_LIMITS
    for _ in range(3):
        observed.add(4.0, 6.0, PACE)
    later = start(observed)
    assert later.total == pytest.approx(1.5 * first.total)
    assert later.basis == BY_DRIVES


def test_turns_count_on_the_way_through_poses() -> None:
    straight = time_at_limits(ROBOT, AT_REST, Pose(8.0, 0.0, 0.0), PATH)
    corner = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0)])
    around = time_at_limits(ROBOT, AT_REST, Pose(4.0, 4.0, math.pi / 2.0), corner)
    assert around - straight == pytest.approx(math.pi / 2.0 / ROBOT.greatest_turn_rate, rel=0.1)


def test_lateness_is_unknown_before_three_drives() -> None:
    observed = ObservedDrives()
    observed.add(4.0, 10.0, PACE)
    assert math.isnan(observed.lateness)
    assert observed.pace is None


def test_the_pace_is_bounded_by_all_drives() -> None:
    observed = ObservedDrives()
    for number in range(5):
        observed.add(4.0, 10.0, Pace(0.5, 0.1 * number, 0.2))
    assert observed.pace == Pace(0.5, pytest.approx(0.4), 0.2)
