"""The fence: the area that the robot may drive in."""

import dataclasses
import math

import pytest
from executions import LIBRARY, ROBOT, chain
from faulty_base import KinematicBase, execute

from ator_ros.domains.soccer.field import BALL
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import STOP, Command, ObjectState

FENCE = Fence.around(ROBOT)


def test_the_fence_is_the_field_and_its_margin() -> None:
    assert Fence(-5.0, -3.5, 5.0, 3.5) == FENCE
    assert FENCE.outside(4.9, -3.4) == 0.0
    assert FENCE.outside(8.0, 7.5) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("top", "pose", "fine"),
    [
        ("goToPose", Pose(4.85, 3.35, 0.0), True),
        ("goToPose", Pose(5.1, 0.0, 0.0), False),
        ("goToBall", Pose(0.0, -3.6, 0.0), False),
        ("dribbleBall", Pose(4.9, 0.0, math.pi), False),  # the axle is behind the ball
        ("shoot", Pose(40.0, 0.0, 0.0), True),  # shoot does not drive to its goal
    ],
)
def test_steps_that_leave_the_fence_are_reported(top: str, pose: Pose, fine: bool) -> None:
    violation = FENCE.violation(chain((top, pose)), ROBOT)
    assert (violation is None) is fine
    assert fine or f"chain.calls[0].goal ({top}): expected a place for the robot inside" in (
        violation or ""
    )


@pytest.mark.parametrize(
    ("pose", "speed", "fine"),
    [
        (Pose(4.9, 0.0, 0.0), 0.0, False),
        (Pose(4.85, 0.0, 0.0), 0.0, True),
        (Pose(4.5, 0.0, 0.0), 0.8, False),  # 0.08 m to a full stop, but 0.4 m as the base brakes
        (Pose(4.5, 0.0, math.pi), 0.8, True),
        (Pose(4.4, 0.0, 0.0), 0.8, True),
    ],
)
def test_a_goal_leaves_room_for_errors_and_for_braking(
    pose: Pose, speed: float, fine: bool
) -> None:
    plan = chain(("goToPose", pose))
    violation = FENCE.violation(
        plan.with_goal(0, dataclasses.replace(plan.calls[0].goal, speed=speed)), ROBOT
    )
    assert (violation is None) is fine
    assert fine or "0.15 m from its edge, with room to stop, got the axle" in (violation or "")


@pytest.mark.parametrize("speed", [0.0, 0.4, 0.8])
def test_accepted_goals_beside_the_edge_succeed(speed: float) -> None:
    def plan(x: float) -> TopChain:
        made = chain(("goToPose", Pose(x, 1.0, 0.0)))
        return made.with_goal(0, dataclasses.replace(made.calls[0].goal, speed=speed))

    small = Fence(-3.0, -3.0, 1.0, 3.0)
    x = max(x for x in (0.01 * cm for cm in range(100)) if small.violation(plan(x), ROBOT) is None)
    for y in (-1.0, 0.0, 1.0, 2.5):
        done = execute(LIBRARY, plan(x), KinematicBase(ROBOT, Pose(-2.0, y, 0.0)), fence=small)
        assert done.ending is Ending.SUCCEEDED, done.execution.reason


def test_a_ball_that_leaves_the_fence_is_not_followed_and_ends_the_goal() -> None:
    def balls(time: float) -> dict[str, ObjectState]:
        rolls = max(0.0, time - 1.0)
        return {BALL: ObjectState(2.0, 2.0 + rolls, 0.0, 1.2 * (rolls > 0.0))}

    base = KinematicBase(ROBOT, Pose(-1.0, 0.0, 0.0))
    done = execute(
        LIBRARY, chain(("goToBall", Pose(2.0, 2.0, 0.0))), base, objects=balls, fence=FENCE
    )
    assert done.ending is Ending.OUT_OF_BOUNDS
    assert "the ball leaves the fence" in done.execution.reason
    assert all(FENCE.outside(state.pose.x, state.pose.y) == 0.0 for _, state in done.states)


@pytest.mark.parametrize("speed", [0.6, 1.2])
def test_a_robot_is_stopped_before_it_leaves_the_fence(speed: float) -> None:
    """The robot is fast and its goal beside the edge: no plan can brake in time."""
    small = Fence(-3.0, -3.0, 1.0, 3.0)
    x = 1.0 - 0.4 * speed**2 / (2.0 * ROBOT.limits.brake)
    moves = Command(speed, 0.0)
    base = KinematicBase(ROBOT, Pose(x, 0.0, 0.0), setpoint=moves, speeds=moves)
    done = execute(LIBRARY, chain(("goToPose", Pose(0.9, 2.0, math.pi / 2))), base, fence=small)
    assert done.ending is Ending.OUT_OF_BOUNDS
    assert "the robot would leave the fence" in done.execution.reason
    assert max(state.pose.x for _, state in done.states) < 1.0
    assert done.commands[-1] == STOP


@pytest.mark.parametrize("yaw", [0.0, 1.5, math.pi])
def test_a_robot_outside_may_drive_in(yaw: float) -> None:
    base = KinematicBase(ROBOT, Pose(5.6, 2.4, yaw))
    done = execute(LIBRARY, chain(("goToPose", Pose(3.5, 2.4, math.pi))), base, fence=FENCE)
    assert done.ending is Ending.SUCCEEDED, done.execution.reason
