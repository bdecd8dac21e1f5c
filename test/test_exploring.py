"""Exploration stays within its share of the predicted time, and tries nothing that is likely to fail."""

from __future__ import annotations

import dataclasses

import pytest
from experience_rows import made_up_model

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.trials import open_speeds, random_trial
from ator_ros.learning.exploring import Explorer
from ator_ros.refinement.chain_prediction import ChainPrediction, predict_chain
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import TopChain

ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)
REFINER = Refiner(ROBOT, {name: made_up_model(name, ROBOT) for name in ("goToPose", "dribbleBall")})


def refined(explorer: Explorer, index: int, success: float | None = 1.0) -> tuple[Refinement, Refinement]:
    """Return what refinement finds in a situation, and what is explored instead."""
    trial = random_trial(SOCCER, next(iter(SOCCER.chains)), LIBRARY, seed=5, index=index)
    found = REFINER.refine(trial.world, open_speeds(trial.chain))

    def predict(chain: TopChain) -> ChainPrediction:
        predicted = predict_chain(trial.world, chain, REFINER.models, ROBOT)
        actions = tuple({**action, "success": success} for action in predicted.actions)
        return dataclasses.replace(predicted, actions=actions)

    return found, explorer.explored(found, predict)


def test_without_a_share_nothing_is_tried() -> None:
    found, answer = refined(Explorer(0.0), 0)
    assert answer is found


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_what_was_tried_costs_its_share_at_most(share: float) -> None:
    explorer = Explorer(share)
    extra = total = 0.0
    for index in range(60):
        found, answer = refined(explorer, index)
        trial = random_trial(SOCCER, next(iter(SOCCER.chains)), LIBRARY, seed=5, index=index)
        usual, tried = (predict_chain(trial.world, chain, REFINER.models, ROBOT).duration
                        for chain in (found.chain, answer.chain))  # fmt: skip
        total += usual
        extra += max(tried - usual, 0.0)
        assert ("exploring" in answer.reason) == (answer is not found)
        assert extra <= share * total + 1e-9
    assert explorer.tried > 3
    assert extra > 0.2 * share * total


def test_what_is_likely_to_fail_is_not_tried() -> None:
    explorer = Explorer(0.5)
    for index in range(10):
        found, answer = refined(explorer, index, success=0.8)
        assert answer is found
