"""An omnidirectional base that does not follow its commands is stopped; see `longest`.

One that follows them raises no fault, and stays inside the fence.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest
from faulty_base import Failure, Goal, KinematicBase, execute
from omni_robots import ROBOTS
from robots import PIONEER

from ator_ros.actions.base import Goal as ActionGoal
from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.domains.drive import DRIVE
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import STOP, Command, RobotState

NAMED = {robot.name: robot for robot in ROBOTS}
START = Pose(0.0, 0.0, 0.0)
GOALS = {
    "ahead": Pose(4.0, 0.0, 0.0),
    "aside": Pose(0.0, 4.0, 0.0),
    "oblique": Pose(3.0, 3.0, 2.5),
    "back": Pose(-3.0, 1.0, -2.0),
    "turn": Pose(0.0, 0.0, 2.5),
}


def run(robot: OmniRobot, goal: Pose, **changes: Any) -> Goal:
    library = DRIVE.library(robot)
    chain = TopChain((TopCall(library["goToPose"], ActionGoal(goal)),))
    base = KinematicBase(robot, START, **changes)
    if base.failure is None:
        return execute(library, chain, base)
    return execute(library, chain, base, longest=base.failure.since + 6.0, until_stood=False)


def moments(plain: Goal) -> set[float]:
    """Return times in s: the start, half-way, and where an axis is fastest."""
    found = {0.0, 0.5 * (plain.ended or 0.0)}
    speeds: list[Callable[[RobotState], float]] = [
        lambda state: abs(state.vx),
        lambda state: abs(state.vy),
        lambda state: abs(state.w),
    ]
    for speed in speeds:
        found.add(max(plain.states, key=lambda item: speed(item[1]))[0])
    return found


def longest(robot: OmniRobot, failure: Failure) -> float:
    """Return the time in s within which a base that fails is stopped.

    It is 0.5 s if the base drives on. The speeds of a base that fails and of one that follows,
    perhaps half as strong, differ later where the base accelerates less, as in `test_base_faults`.
    A base whose own command fails on one axis brakes there before it stands.
    """
    if failure.kind == "constant":
        return 0.5
    of_weak = 0.5 * max(1.0, PIONEER.limits.a / robot.limits.least_change)
    if failure.place != "command":
        return of_weak
    braking = {axis.name: axis.limit / axis.rate for axis in robot.axes}
    return of_weak + braking[failure.axis]


def late_stops(robot: OmniRobot, goals: list[Pose], places: tuple[str, ...]) -> dict[str, float]:
    """Return the failures that were stopped later than `longest`, with these times in s."""
    found = {}
    for goal in goals:
        plain = run(robot, goal)
        assert plain.ending is Ending.SUCCEEDED, plain.execution.reason
        for since in moments(plain):
            for axis in robot.axes:
                kinds = [(kind, place, 0.0) for kind in ("stuck", "reversed") for place in places]
                kinds += [("constant", "motion", share * axis.limit) for share in (0.7, -0.4)]
                for kind, place, value in kinds:
                    failure = Failure(kind, axis.name, since, place, value)
                    done = run(robot, goal, failure=failure)
                    if done.late > longest(robot, failure) + 1e-6:
                        found[f"{goal} {failure}: {done.execution.reason}"] = done.late
    return found


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("goal", GOALS)
def test_one_that_follows_raises_no_fault(name: str, goal: str) -> None:
    done = run(NAMED[name], GOALS[goal])
    assert done.ending is Ending.SUCCEEDED, done.execution.reason
    assert done.watch.remark == ""


@pytest.mark.parametrize("changes", [{"strength": 0.8}, {"share": 0.6}, {"latency": 0.1}])
@pytest.mark.parametrize("goal", ["ahead", "oblique"])
def test_one_weaker_slower_or_later_than_described_raises_no_fault(
    changes: dict[str, float], goal: str
) -> None:
    for robot in ROBOTS:
        done = run(robot, GOALS[goal], **changes)
        assert done.ending is not Ending.BASE_FAULT, done.execution.reason


@pytest.mark.parametrize("name", NAMED)
def test_one_that_fails_on_any_axis_is_stopped(name: str) -> None:
    goals = [GOALS["oblique"]]
    assert late_stops(NAMED[name], goals, ("motion",)) == {}


@pytest.mark.long
@pytest.mark.parametrize("name", NAMED)
def test_each_failure_is_detected_on_each_drive(name: str) -> None:
    places = ("command", "motion", "odometry")
    assert late_stops(NAMED[name], list(GOALS.values()), places) == {}


@pytest.mark.parametrize("direction", [0.0, 1.5, 3.0, -2.0])
@pytest.mark.parametrize("name", NAMED)
def test_it_is_stopped_before_it_leaves_the_fence(name: str, direction: float) -> None:
    """It moves fast in any direction while it turns, and no plan can brake in time."""
    robot = NAMED[name]
    speed = 0.9 * robot.limits.sideways
    late = 0.1 + 2.0 * robot.motor_time_constant  # s; two messages, and the motors
    x = 1.0 - late * speed - speed**2 / (2.0 * robot.stop.moving)
    assert 1.0 - x < speed**2 / (2.0 * robot.limits.least_change)
    turning = 0.3 * robot.limits.w
    moves = Command(speed * math.cos(direction), turning, vy=speed * math.sin(direction))
    base = KinematicBase(robot, Pose(x, 0.0, -direction), setpoint=moves, speeds=moves)
    library = DRIVE.library(robot)
    chain = TopChain((TopCall(library["goToPose"], ActionGoal(Pose(0.5, 0.0, 0.0))),))
    done = execute(library, chain, base, fence=Fence(-9.0, -9.0, 1.0, 9.0))
    assert done.ending is Ending.OUT_OF_BOUNDS
    assert "the robot would leave the fence" in done.execution.reason
    assert max(state.pose.x for _, state in done.states) < 1.0
    assert done.commands[-1] == STOP


@pytest.mark.parametrize("name", NAMED)
def test_a_goal_beside_the_edge_of_the_fence_succeeds(name: str) -> None:
    robot = NAMED[name]
    library = DRIVE.library(robot)
    fence = Fence(-5.0, -5.0, 1.0, 5.0)
    call = TopCall(library["goToPose"], ActionGoal(Pose(0.8, 1.0, 1.5)))
    for start in (Pose(-3.0, 0.0, 0.0), Pose(0.5, -3.0, -2.0)):
        done = execute(library, TopChain((call,)), KinematicBase(robot, start), fence=fence)
        assert done.ending is Ending.SUCCEEDED, done.execution.reason
