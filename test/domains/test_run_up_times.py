"""The times of ideal run-ups are those of the planner, though they come from far fewer candidates."""

from __future__ import annotations

import numpy as np
import pytest
from robots import OTHERS, PIONEER

from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.planned.holding import run_up_sides
from ator_ros.domains.soccer.planned.release import scoring_time
from ator_ros.domains.soccer.planned.shoot import Shoot, run_up
from ator_ros.domains.soccer.run_up_times import run_up_times
from ator_ros.geometry import FloatArray, Pose
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


@pytest.mark.parametrize("robot", [OTHERS[-1]], ids=lambda robot: robot.name)
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


def test_both_goals_are_alike() -> None:
    features = {feature.name: feature for feature in SOCCER.features}
    start = drawn(PIONEER, 1)[0]
    rows = [(start.pose, 4.0), (Pose(-start.pose.x, -start.pose.y, start.pose.yaw + np.pi), -4.0)]
    direct = {name: np.array([getattr(pose, name) for pose, _ in rows]) for name in ("x", "y", "yaw")}
    direct |= {"v": np.full(2, start.v), "xg": np.array([goal for _, goal in rows])}
    direct |= {name: np.zeros(2) for name in GENERAL["path_time"].derives - direct.keys()}
    left, right = features["run_up_time"].compute(Geometry(direct, PIONEER))
    assert left == pytest.approx(right)
