"""Goals that are passed without a stop: what is judged, and where the robot must stop."""

import dataclasses
import math

import pytest

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import STOP, STOPS, passes, wrong_values
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopCall, TopChain, projected
from ator_ros.tops.conditions import Condition, Term
from ator_ros.world.state import RobotState, World

ROBOT = load_robot()
POST = Condition(
    (
        Term("robot.x", "goal.x", 0.3),
        Term("robot.y", "goal.y", 0.3),
        Term("robot.yaw", "goal.yaw", 0.3),
    )
)
VISIT = Top("visit", "drive", Condition(), POST)
START = World(0.0, RobotState(Pose(0.0, 0.0, 0.0), 0.0))


def call(x: float, y: float = 0.0, *, stop: float = 1.0, top: Top = VISIT) -> TopCall:
    return TopCall(top, Goal(Pose(x, y, math.pi), values={STOP: stop}))


def chain(*calls: TopCall) -> TopChain:
    return TopChain(calls)


@pytest.mark.parametrize(
    ("pose", "fits"),
    [
        (Pose(1.0, 0.0, 0.0), True),  # another heading than the goal's
        (Pose(0.75, 0.2, 2.0), True),
        (Pose(0.65, 0.0, math.pi), False),  # 35 cm before it
    ],
)
def test_only_the_position_of_a_passed_goal_is_judged(pose: Pose, fits: bool) -> None:
    driving = World(0.0, RobotState(pose, 0.6))
    assert (not VISIT.unmet(driving, call(1.0, stop=0.0).goal, ROBOT)) is fits
    stopping = VISIT.unmet(driving, call(1.0).goal, ROBOT)
    assert any("yaw" in reason for reason in stopping) is (pose.yaw != math.pi)


def test_the_last_step_stops() -> None:
    passed = call(1.0, stop=0.0)
    assert not chain(passed, call(2.0)).violations(START, ROBOT)
    (reason,) = chain(call(2.0), passed).violations(START, ROBOT)
    assert reason == "step 2 (visit): passing: the last step of a chain must stop"


def test_the_robot_stops_before_another_action() -> None:
    other = dataclasses.replace(VISIT, name="dock", action="docking")
    (reason,) = chain(call(1.0, stop=0.0), call(2.0, top=other)).violations(START, ROBOT)
    assert reason == "step 1 (visit): passing: it must stop before another action, docking"


def test_after_a_passed_goal_the_robot_looks_along_its_way() -> None:
    after = projected(START, call(1.0, 1.0, stop=0.0), ROBOT)
    assert after.robot.pose == pytest.approx(Pose(1.0, 1.0, math.pi / 4.0))


def test_stop_opens_the_speed_of_an_action_that_cannot_pass() -> None:
    opened = dataclasses.replace(call(1.0), open=frozenset({STOP}))
    assert opened.opens(STOP)
    assert not opened.opens("speed")
    plain = dataclasses.replace(opened, goal=Goal(Pose(1.0, 0.0, 0.0)))
    assert plain.opens("speed")
    everything = dataclasses.replace(call(1.0), open=frozenset({"*"}))
    assert not everything.opens(STOP)  # it would give up the heading


def test_a_goal_stops_or_passes() -> None:
    assert passes(call(1.0, stop=0.0).goal)
    assert not passes(Goal(Pose(1.0, 0.0, 0.0)))
    assert wrong_values(call(1.0, stop=0.5).goal, [STOPS]) == "stop: expected 0 or 1, got 0.5"
