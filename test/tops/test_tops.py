"""TOPs, chains and the chain executor."""

from __future__ import annotations

import pytest

from ator_ros.actions.base import Goal, Status
from ator_ros.domains.domain import DomainError
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.geometry import Pose
from ator_ros.robot.description import load_robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, ObjectState, RobotState, World

ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)
START = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), {BALL: ObjectState(0.0, 0.0)})


def call(top: str, x: float, y: float, yaw: float = 0.0, speed: float = 0.0) -> TopCall:
    return TopCall(LIBRARY[top], Goal(Pose(x, y, yaw), speed, LIBRARY[top].point))


PLAN = TopChain((call("goToBall", 0.0, 0.0), call("dribbleBall", 2.0, 0.5, 0.3), call("shoot", 4.0, 0.0)))


def execute(chain: TopChain, start: World = START, **options: float) -> tuple[ChainExecutor, list, World]:
    executor, steps = ChainExecutor(LIBRARY, chain, **options), []
    with Simulation(ROBOT) as simulation:
        simulation.place_robot(start.robot.pose)
        simulation.place_object(BALL, ball_of(start).x, ball_of(start).y)
        while not steps or steps[-1].status is Status.RUNNING:
            steps.append(executor.step(simulation.world()))
            simulation.command(steps[-1].command)
            simulation.tick()
        return executor, steps, simulation.world()


def test_a_valid_chain_has_no_violations() -> None:
    assert PLAN.violations(START, ROBOT) == []


@pytest.mark.parametrize(
    ("chain", "violation"),
    [
        (TopChain(()), "empty chain"),
        (TopChain((call("dribbleBall", 1.0, 0.0),)), "step 1 (dribbleBall) now"),
        (TopChain((call("goToBall", 1.0, 1.0),)), "ball.x within 0.1 of goal.x"),
        (
            TopChain((call("goToPose", 1.0, 1.0), call("shoot", 4.0, 0.0))),
            "step 2 (shoot) after step 1 (goToPose)",
        ),
    ],
)
def test_an_invalid_chain_has_violations(chain: TopChain, violation: str) -> None:
    assert violation in "; ".join(chain.violations(START, ROBOT))


def test_the_chain_of_the_paper_is_executed_to_its_end() -> None:
    executor, steps, world = execute(PLAN)
    assert steps[-1].status is Status.SUCCEEDED
    assert steps[-1].command == STOP
    assert [record.top for record in executor.records] == ["goToBall", "dribbleBall", "shoot"]
    assert sum(record.duration for record in executor.records) == pytest.approx(executor.elapsed)
    assert ball_of(world).x > 4.0


def test_unknown_tops_of_a_library_are_reported() -> None:
    empty = TopLibrary(ROBOT, "empty", tops=(Top("soar", "fly", Condition(), Condition()),), actions={})
    assert (dict(empty), empty.get("soar")) == ({}, None)
    with pytest.raises(KeyError, match=r"^soar needs the action fly; action set empty has none of"):
        empty["soar"]
    with pytest.raises(DomainError, match="expected one of"):
        SOCCER.library(ROBOT, "none")
    with pytest.raises(KeyError, match="goToBall"):
        LIBRARY["fly"]
