"""Odometry of another point than the axle's middle is named where goals end because of it."""

import numpy as np
import pytest
from executions import LIBRARY, ROBOT, chain
from faulty_base import Goal, KinematicBase, execute

from ator_ros.execution.chain_executor import Ending
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.world.state import RobotState

GOALS = (Pose(1.0, 1.0, 2.5), Pose(-1.0, 0.5, 0.3), Pose(0.0, 0.0, 2.5))


def driven(goal: Pose, ahead: float, *, noise: float = 0.0) -> Goal:
    """Drive to a pose with odometry of a point `ahead` m before the axle, and noise in m."""
    rng = np.random.default_rng(7)

    def sense(_: float, state: RobotState) -> RobotState:
        x, y, yaw = state.pose.ahead(ahead)
        pose = Pose(
            x + rng.normal(0.0, noise),
            y + rng.normal(0.0, noise),
            wrap_angle(yaw + rng.normal(0.0, noise)),
        )
        return RobotState(pose, state.vx, state.w)

    base = KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0))
    return execute(LIBRARY, chain(("goToPose", goal)), base, sense=sense, longest=31.0)


@pytest.mark.parametrize(("ahead", "where"), [(0.2, "ahead of"), (-0.2, "behind")])
@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("goal", GOALS)
def test_another_point_is_named(goal: Pose, ahead: float, where: str, noise: float) -> None:
    done = driven(goal, ahead, noise=noise)
    assert done.ending in (Ending.SUCCEEDED, Ending.FAILED)
    assert f"describe a point about 0.20 m {where} the axle" in done.watch.remark


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.01])
@pytest.mark.parametrize("goal", GOALS)
def test_the_middle_of_the_axle_is_not_doubted(goal: Pose, noise: float) -> None:
    assert driven(goal, 0.0, noise=noise).watch.remark == ""


def test_a_jump_of_the_pose_is_no_sideways_motion() -> None:
    done = driven(GOALS[0], 0.0)
    watch = done.watch
    for tick in range(100):  # localization corrects the pose by 5 cm each half second
        time, yaw = 100.0 + 0.05 * tick, 0.05 * tick
        pose = Pose(0.05 * (tick // 10 % 2), 0.0, wrap_angle(yaw))
        watch.fault(time, RobotState(pose, 0.0, 1.0), time)
    assert watch.remark == ""
