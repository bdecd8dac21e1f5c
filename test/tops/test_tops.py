"""TOPs, chains and the chain executor."""

import pytest
from refinement_fakes import LIBRARY, ROBOT, call

from ator_ros.domains.domain import DomainError
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopChain
from ator_ros.tops.conditions import Condition
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

START = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), {BALL: ObjectState(0.0, 0.0)})


PLAN = TopChain(
    (
        call("goToBall", 0.0, 0.0, 0.0),
        call("dribbleBall", 2.0, 0.5, 0.3),
        call("shoot", 4.0, 0.0, 0.0),
    )
)


def test_a_valid_chain_has_no_violations() -> None:
    assert PLAN.violations(START, ROBOT) == []


@pytest.mark.parametrize(
    ("chain", "violation"),
    [
        (TopChain(()), "empty chain"),
        (TopChain((call("dribbleBall", 1.0, 0.0, 0.0),)), "step 1 (dribbleBall) now"),
        (TopChain((call("goToBall", 1.0, 1.0, 0.0),)), "ball.x within 0.1 of goal.x"),
        (
            TopChain((call("goToPose", 1.0, 1.0, 0.0), call("shoot", 4.0, 0.0, 0.0))),
            "step 2 (shoot) after step 1 (goToPose)",
        ),
    ],
)
def test_an_invalid_chain_has_violations(chain: TopChain, violation: str) -> None:
    assert violation in "; ".join(chain.violations(START, ROBOT))


def test_unknown_tops_of_a_library_are_reported() -> None:
    empty = TopLibrary(
        ROBOT, "empty", tops=(Top("soar", "fly", Condition(), Condition()),), actions={}
    )
    assert (dict(empty), empty.get("soar")) == ({}, None)
    with pytest.raises(KeyError, match=r"^soar needs the action fly; action set empty has none of"):
        empty["soar"]
    with pytest.raises(DomainError, match="expected one of"):
        SOCCER.library(ROBOT, "none")
    with pytest.raises(KeyError, match="goToBall"):
        LIBRARY["fly"]
