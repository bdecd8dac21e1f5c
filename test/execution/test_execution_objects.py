"""Supervisor with objects other than a ball: waiting, following and timeouts by object name."""

import pytest
from executions import ROBOT, execution
from turning_action import TurnDriveTurn

from ator_ros.actions.base import Goal
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.supervisor import Supervisor
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, ObjectState, RobotState, World

VISIT = Top(
    "visit",
    "drive",
    Condition((Term("cup.x", "goal.x", 0.1), Term("cup.y", "goal.y", 0.1))),
    Condition((Term("robot.x", "cup.x", 0.1), Term("robot.y", "cup.y", 0.1))),
)
LIBRARY = TopLibrary(ROBOT, "visiting", tops=(VISIT,), actions={"drive": TurnDriveTurn})
CUP, OTHER = ObjectState(2.0, 0.0), ObjectState(-1.0, 0.0)


def world(tick: int, **objects: ObjectState) -> World:
    return World(1.0 + 0.05 * tick, RobotState(Pose(0.0, 0.0, 0.0)), objects)


@pytest.fixture
def run() -> Supervisor:
    visit = TopChain((TopCall(VISIT, Goal(Pose(2.0, 0.0, 0.0))),))
    return execution(visit, library=LIBRARY, again_after=0.0)


def test_a_step_follows_only_its_own_object(run: Supervisor) -> None:
    run.tick(world(0, cup=CUP, cupboard=OTHER), 100.0)
    assert run.tick(world(1, cup=CUP, cupboard=ObjectState(-1.0, 2.0)), 100.05).vx > 0.0
    assert run.executor.chain.calls[0].goal.pose == Pose(2.0, 0.0, 0.0)
    run.tick(world(2, cup=ObjectState(2.0, 0.5), cupboard=OTHER), 100.1)
    assert run.executor.chain.calls[0].goal.pose == Pose(2.0, 0.5, 0.0)
    assert run.ending is None


def test_a_step_pauses_while_its_object_is_overdue_and_then_ends(run: Supervisor) -> None:
    run.tick(world(0, cup=CUP), 100.0)
    assert run.tick(world(1, cup=CUP), 100.05, overdue=frozenset({"cupboard"})).vx > 0.0
    assert run.tick(world(2, cup=CUP), 100.1, overdue=frozenset({"cup"})) == STOP
    assert run.reason == "visit paused: no recent message of the cup"
    for tick in (3, 4):
        assert run.ending is None
        assert run.tick(world(tick, cupboard=OTHER), 100.0 + 0.05 * tick) == STOP
    assert run.ending is Ending.INPUT_LOST
    assert run.reason == "cup is missing: visit needs it, and no recent one is known"
