"""Requests outside the experience of the performance models: said in the answer, and not refined."""

from __future__ import annotations

import dataclasses

import pytest

from ator_ros.actions.base import Goal, Point
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
MODELS = load_models(ROBOT, SOCCER.known_features)
LIBRARY = SOCCER.library(ROBOT)
YAW = frozenset({"yaw"})


def request(start: float, end: float, opened: frozenset[str] = YAW) -> tuple[World, TopChain]:
    """Return a robot that goes to a ball `start` m ahead and dribbles it `end` m to the left."""
    ball, there = Pose(start, 0.0, 0.0), Pose(start, end, 1.5708)
    fetch = TopCall(LIBRARY["goToBall"], Goal(ball, 0.0, Point.HOLD), opened)
    dribble = TopCall(LIBRARY["dribbleBall"], Goal(there, 0.0, Point.HOLD))
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(ball.x, ball.y)})
    return world, TopChain((fetch, dribble))


def test_requests_inside_the_experience_are_answered_without_a_remark() -> None:
    answer = Refiner(ROBOT, MODELS).refine(*request(2.0, 2.0))
    assert answer.refined
    assert "outside the experience" not in answer.reason


def test_a_step_outside_the_experience_is_named_and_its_subgoals_stay() -> None:
    answer = Refiner(ROBOT, MODELS).refine(*request(2.0, 21.0))
    assert "step 2 (dribbleBall): distance 21.0 m is outside the experience of" in answer.reason
    assert not answer.refined
    assert not answer.free
    (kept,) = answer.not_free
    assert (kept.subgoal, kept.name) == (0, "yaw")
    assert "step 2" in kept.reason


def test_a_chain_without_open_variables_has_the_remark_too() -> None:
    answer = Refiner(ROBOT, MODELS).refine(*request(30.0, 2.0, frozenset()))
    assert "step 1 (goToBall): distance" in answer.reason
    assert "step 2" not in answer.reason


def test_subgoals_away_from_the_step_are_refined() -> None:
    world, chain = request(2.0, 2.0)
    far = TopCall(LIBRARY["goToPose"], Goal(Pose(40.0, 0.0, 0.0)))
    there = dataclasses.replace(chain.calls[1], open=YAW)
    answer = Refiner(ROBOT, MODELS).refine(world, TopChain((chain.calls[0], there, far)))
    assert {(each.subgoal, each.name) for each in answer.free} == {(0, "yaw")}
    assert answer.chain.calls[1:] == (there, far)
    assert "step 3 (goToPose): distance" in answer.reason


@pytest.mark.parametrize(("action", "turned"), [("goToPose", 3.0), ("goToPose", -2.0)])
def test_headings_and_speeds_are_compared_too(action: str, turned: float) -> None:
    model = MODELS[action]
    starts = {**model.metadata["training"]["starts"], "turn": [0.0, 0.5], "v": [0.0, 0.1]}
    metadata = {**model.metadata, "training": {"starts": starts}}
    known = {action: dataclasses.replace(model, metadata=metadata)}
    chain = TopChain((TopCall(LIBRARY["goToPose"], Goal(Pose(1.0, 0.0, turned))),))
    answer = Refiner(ROBOT, known).refine(World(0.0, RobotState(Pose(0.0, 0.0, 0.0), 0.7)), chain)
    assert f"turn {abs(turned):.1f} rad is outside the experience of 0.0 to 0.5 rad" in answer.reason
    assert "speed at the start 0.7 m/s is outside the experience of 0.0 to 0.1 m/s" in answer.reason


def test_models_that_know_no_ranges_say_nothing() -> None:
    known = {name: dataclasses.replace(model, metadata={}) for name, model in MODELS.items()}
    answer = Refiner(ROBOT, known).refine(*request(2.0, 21.0))
    assert "outside the experience" not in answer.reason
