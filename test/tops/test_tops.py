"""TOPs, chains and the chain executor."""

import pytest
from refinement_fakes import LIBRARY, ROBOT, call

from ator_ros.actions.base import Goal
from ator_ros.bases.description import load_robot
from ator_ros.domains.domain import Domain, DomainError
from ator_ros.domains.drive import DRIVE
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term
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


@pytest.mark.parametrize(
    ("x", "opened", "unmet"),
    [
        (-7.2, (), []),
        (0.0, (), ["expected robot.x within 0.3 of -7.0, it is 6.7 beyond"]),
        (0.0, ("x",), []),  # refinement may still change it
        (0.0, ("y",), ["expected robot.x within 0.3 of -7.0, it is 6.7 beyond"]),
    ],
)
def test_a_goal_that_contradicts_the_post_condition_is_reported(
    x: float, opened: tuple[str, ...], unmet: list[str]
) -> None:
    post = Condition((Term("robot.x", -7.0, 0.3), Term("robot.y", "goal.y", 0.3)))
    back = Top("backToBase", "goToPose", Condition(), post)
    step = TopCall(back, Goal(Pose(x, 1.0, 0.0)), frozenset(opened))
    assert step.contradictions(ROBOT) == unmet


@pytest.mark.parametrize("domain", [SOCCER, DRIVE])
def test_goals_of_the_tops_of_shipped_domains_contradict_none(domain: Domain) -> None:
    robot = load_robot()
    library = domain.library(robot)
    for top in library.values():
        step = TopCall(top, library.goal(top, Pose(1.0, 0.5, 0.3)))
        assert step.contradictions(robot) == []


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
