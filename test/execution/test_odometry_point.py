"""Odometry of another point than the axle's middle is named where goals end because of it."""

import numpy as np
import pytest
from executions import LIBRARY, ROBOT, chain
from faulty_base import Failure, Goal, KinematicBase, execute

from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.odometry_point import OdometryPoint
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.world.state import RobotState

GOALS = (Pose(1.0, 1.0, 2.5), Pose(-1.0, 0.5, 0.3), Pose(0.0, 0.0, 2.5))


def driven(
    goal: Pose,
    offset: tuple[float, float],
    *,
    noise: float = 0.0,
    own_twist: bool = False,
    base: KinematicBase | None = None,
) -> Goal:
    """Drive to a pose with odometry of a point `offset` m ahead and to the left of the axle.

    The poses have `noise` in m and rad; the twist is the axle's, or with `own_twist` the point's.
    """
    rng = np.random.default_rng(7)

    def sense(_: float, state: RobotState) -> RobotState:
        x, y, yaw = state.pose.compose(Pose(*offset, 0.0))
        dx, dy, turn = rng.normal(0.0, noise, 3)
        sideways = offset[1] * state.w if own_twist else 0.0
        return RobotState(
            Pose(x + dx, y + dy, wrap_angle(yaw + turn)), state.vx - sideways, state.w
        )

    base = base or KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0))
    return execute(LIBRARY, chain(("goToPose", goal)), base, sense=sense, longest=7.0)


@pytest.mark.parametrize(
    ("offset", "where"),
    [
        ((0.2, 0.0), "ahead of the axle"),
        ((-0.2, 0.0), "behind the axle"),
        ((0.0, 0.2), "to the left of the axle's middle"),
        ((0.0, -0.2), "to the right of the axle's middle"),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_another_point_is_named(offset: tuple[float, float], where: str, noise: float) -> None:
    remark = driven(GOALS[2], offset, noise=noise).watch.remark
    assert f"describe a point about 0.20 m {where}" in remark
    assert remark.count("about") == 1


def test_both_coordinates_of_another_point_are_named() -> None:
    remark = driven(GOALS[2], (0.2, 0.1)).watch.remark
    assert "0.20 m ahead of the axle and about 0.10 m to the left of the axle's middle" in remark


@pytest.mark.parametrize("left", [0.2, -0.2, 0.15, -0.15])
@pytest.mark.parametrize("goal", GOALS)
def test_a_fault_due_to_a_point_beside_the_axle_names_it(goal: Pose, left: float) -> None:
    """Its own twist differs from the commands in each turn."""
    done = driven(goal, (0.0, left), own_twist=True)
    assert done.ending is Ending.BASE_FAULT
    side = "left" if left > 0.0 else "right"
    assert f"m to the {side} of the axle's middle" in done.watch.cause


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.01])
@pytest.mark.parametrize("goal", GOALS)
def test_the_middle_of_the_axle_is_not_doubted(goal: Pose, noise: float) -> None:
    assert driven(goal, (0.0, 0.0), noise=noise).watch.remark == ""


@pytest.mark.parametrize("weakness", [{"strength": 0.5}, {"share": 1.1}, {"lag": 0.2}])
def test_a_base_that_follows_badly_does_not_seem_to_have_another_point(
    weakness: dict[str, float],
) -> None:
    base = KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0), **weakness)
    assert "describe" not in driven(GOALS[0], (0.0, 0.0), base=base).watch.remark


def test_a_point_beyond_the_robot_is_not_suspected() -> None:
    runs_away = Failure("constant", "vx", 0.3, "motion", 0.84)
    base = KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0), failure=runs_away)
    done = driven(GOALS[2], (0.0, 0.0), base=base)
    assert done.ending is Ending.BASE_FAULT
    assert done.watch.cause == ""


def arc(offset: Pose, *, jump: float = 0.0) -> str:
    """Return the remark on 5 s of turning at 1 rad/s with the pose of a point at `offset`.

    It is corrected by `jump` m to and fro each half second, as by a localization.
    """
    return point_of(offset, 100, jump=jump).remark


def point_of(offset: Pose, ticks: int, *, jump: float = 0.0) -> OdometryPoint:
    """Return the estimate after some ticks of turning at 1 rad/s; see `arc`."""
    point = OdometryPoint(ROBOT.reach)
    for tick in range(ticks):
        shift = jump * (tick // 10 % 2)
        pose = Pose(shift, 0.0, wrap_angle(0.05 * tick)).compose(offset)
        point.update(0.05 * tick, pose, 0.0)
    return point


def test_a_jump_of_the_pose_is_no_motion_of_another_point() -> None:
    assert arc(Pose(0.0, 0.0, 0.0), jump=0.05) == ""
    assert "0.15 m behind" in arc(Pose(-0.15, 0.0, 0.0))


def test_a_point_is_suspected_after_few_steps_and_named_after_a_turn_by_0_3_rad() -> None:
    beside = Pose(0.0, 0.15, 0.0)
    early = point_of(beside, 6)  # 0.25 rad
    assert early.remark == ""
    assert early.suspicion().startswith("or odometry describes a point about 0.15 m to the left")
    assert point_of(beside, 3).suspicion() == ""
    late = point_of(beside, 9)
    assert "about 0.15 m to the left" in late.remark
    assert late.suspicion() == late.remark


@pytest.mark.parametrize("offset", [Pose(0.05, 0.0, 0.0), Pose(0.0, -0.05, 0.0)])
def test_an_offset_with_which_drives_arrive_is_not_named(offset: Pose) -> None:
    assert arc(offset) == ""
    assert point_of(offset, 6).suspicion() == ""
