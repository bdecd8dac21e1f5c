"""The times of ideal run-ups are those of the planner, though they come from far fewer candidates."""

from __future__ import annotations

import numpy as np
import pytest
from robots import OTHERS, PIONEER

from ator_ros.domains.soccer import run_up_times as run_up_times_module
from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.features import shot
from ator_ros.domains.soccer.planned.holding import run_up_sides
from ator_ros.domains.soccer.planned.release import release, scoring_time
from ator_ros.domains.soccer.planned.shoot import Shoot, run_up
from ator_ros.domains.soccer.run_up_times import _shot, run_up_times
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.durations import rates_of
from ator_ros.performance.derived import Geometry
from ator_ros.performance.features import GENERAL
from ator_ros.robot.description import Robot
from ator_ros.world.state import RobotState

MOUTH = Pose(4.0, 0.0, 0.0)


def planned(robot: Robot, start: RobotState) -> float:
    """Return the time in s until the ball is in the goal on the planner's run-up; infinite without one."""
    limits, speed = Shoot(robot).plan_limits, round(max(0.0, start.v), 3)
    planning = run_up(robot, start.pose, MOUTH, run_up_sides(robot, limits, speed), limits)
    while True:
        try:
            next(planning)
        except StopIteration as end:
            return np.inf if end.value is None else scoring_time(robot, MOUTH, end.value)


def drawn(robot: Robot, count: int) -> list[RobotState]:
    rng = np.random.default_rng(4)
    return [situations.shoot(robot, rng).robot for _ in range(count)]


def columns(starts: list[RobotState]) -> FloatArray:
    seen = [(MOUTH.relative(start.pose), start.v) for start in starts]
    return np.array([(*pose, v) for pose, v in seen]).T


@pytest.mark.parametrize("robot", [PIONEER, *OTHERS], ids=lambda robot: robot.name)
def test_run_ups_take_as_long_as_planned(robot: Robot) -> None:
    starts = drawn(robot, 25)
    times = run_up_times(robot, columns(starts))
    plans = np.array([planned(robot, start) for start in starts])
    both = np.isfinite(times) & np.isfinite(plans)
    assert both.sum() >= 8
    assert (np.isfinite(times) == np.isfinite(plans)).mean() >= 0.9
    difference = times[both] - plans[both]
    assert difference.min() > -0.25
    assert np.median(np.abs(difference)) < 0.2
    assert np.mean(np.abs(difference) < 1.0) >= 0.7


def test_a_shot_that_is_just_too_late_takes_a_turn_all_round() -> None:
    """Refinement chose such ends of a dribble, where a few fixed shots told nothing of the difference."""
    late, in_time = (RobotState(Pose(x, 0.89, 0.226), 0.8) for x in (3.0, 2.7))
    short, long = run_up_times(PIONEER, columns([in_time, late]))
    assert short < 2.0
    assert long > 5.0
    direct = {name: np.zeros(2) for name in ("w", "yg", "yawg", "speedg", "hold")}
    direct |= {"x": np.array([2.7, 3.0]), "y": np.full(2, 0.89), "yaw": np.full(2, 0.226)}
    direct |= {"v": np.full(2, 0.8), "xg": np.full(2, 4.0)}
    fixed = Geometry(direct, PIONEER).once(shot).time
    assert abs(fixed[1] - fixed[0]) < 1.0


def test_shots_are_those_of_the_planner() -> None:
    rng, (limits, _, setting) = np.random.default_rng(6), run_up_times_module._tables(PIONEER)
    x, y, heading, speed = rng.uniform((-3.0, -2.0, -1.0, 0.0), (0.0, 2.0, 1.0, limits.v), (1000, 4)).T
    planned_shots = release(PIONEER, x, y, heading, speed, limits)
    lines = setting.half_width - np.abs(y + PIONEER.hold * np.sin(heading)
                                        - (x + PIONEER.hold * np.cos(heading)) * np.tan(heading))  # fmt: skip
    meets = lines * np.cos(heading) - setting.reach >= setting.room
    rows = zip(x, y, np.cos(heading), np.sin(heading), speed, strict=True)
    times = np.array([_shot(*row, np.inf, setting, rates_of(limits)) for row in rows])
    assert 50 < planned_shots.allowed.sum() < 950
    assert np.array_equal(meets & np.isfinite(times), planned_shots.allowed)
    allowed = planned_shots.allowed
    assert times[allowed] == pytest.approx(planned_shots.time[allowed], abs=1e-9)


def test_both_goals_are_alike() -> None:
    features = {feature.name: feature for feature in SOCCER.features}
    start = drawn(PIONEER, 1)[0]
    rows = [(start.pose, 4.0), (Pose(-start.pose.x, -start.pose.y, start.pose.yaw + np.pi), -4.0)]
    direct = {name: np.array([getattr(pose, name) for pose, _ in rows]) for name in ("x", "y", "yaw")}
    direct |= {"v": np.full(2, start.v), "xg": np.array([goal for _, goal in rows])}
    direct |= {name: np.zeros(2) for name in GENERAL["path_time"].derives - direct.keys()}
    left, right = features["run_up_time"].compute(Geometry(direct, PIONEER))
    assert left == pytest.approx(right)


@pytest.mark.parametrize("row", range(4))
def test_no_number_reads_beyond_the_tables(row: int) -> None:
    starts = np.repeat(columns(drawn(PIONEER, 1)), 5, axis=1)
    starts[row] = (np.nan, np.inf, -np.inf, 1e9, -1e9)
    times = run_up_times(PIONEER, starts)
    assert np.isnan(times[:3]).all()
    assert not np.isnan(times[3:]).any()
