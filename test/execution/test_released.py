"""A step whose robot somebody else moves is not paused, since no command of ours may disturb."""

from __future__ import annotations

from carried import CALL, Ledger, Sent, begun

from ator_ros.execution.supervisor import Phase
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopChain
from ator_ros.world.inputs import Inputs
from ator_ros.world.state import STOP, ObjectState, RobotState, World


def late(goal: Sent) -> World:
    """Return the next state, in which the object that the step needs is overdue."""
    return World(goal.now + 0.05, RobotState(Pose(0.0, 0.0, 0.0)), {"mark": ObjectState(2.0, 0.0)})


def test_an_overdue_object_does_not_pause_it() -> None:
    goal = begun(Ledger())
    state = late(goal)
    assert goal.execution.tick(state, state.time, overdue=frozenset({"mark"})) is None


def test_an_overdue_object_pauses_a_step_before_it_is_released() -> None:
    goal = Sent(Ledger(), TopChain((CALL,)))
    goal.tick()
    state = late(goal)
    assert goal.execution.phase is Phase.EXECUTING
    assert goal.execution.tick(state, state.time, overdue=frozenset({"mark"})) == STOP
    assert "no recent message of the mark" in goal.execution.reason


def test_late_odometry_does_not_stop_it_until_the_goal_ends() -> None:
    goal = begun(Ledger())
    assert not goal.execution.silent(goal.now + 0.2)
    goal.execution.watch(goal.now + 0.4)
    assert goal.execution.phase is Phase.ENDED
    assert "odom is missing" in goal.execution.reason


def test_after_a_pause_the_robot_stands_soon_and_the_goal_waits_longer() -> None:
    inputs, robot, slowdown = Inputs({}), RobotState(Pose(0.0, 0.0, 0.0)), 1.0
    for tick in range(80):
        inputs.robot(0.05 * tick, robot, 0.05 * tick + (3.0 if tick >= 60 else 0.0))
        slowdown = max(slowdown, inputs.slowdown)
    assert slowdown > 8.0
    goal = Sent(Ledger(), TopChain((CALL,)))
    goal.tick()
    goal.execution.slowdown = slowdown
    assert not goal.execution.silent(goal.now + 0.7)
    assert goal.execution.silent(goal.now + 0.8)  # five times half of 0.3 s
    goal.execution.watch(goal.now + 1.2)
    assert goal.execution.phase is Phase.EXECUTING


def test_late_odometry_stops_a_goal_that_is_not_released() -> None:
    goal = Sent(Ledger(), TopChain((CALL,)))
    goal.tick()
    assert goal.execution.silent(goal.now + 0.2)
