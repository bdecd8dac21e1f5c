"""The warm-up of refinement with the shipped models."""

from __future__ import annotations

import pytest

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.execution.predictions import warm_up_refinement
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.refiner import Refinement, Refiner

ROBOT = SOCCER.robot()


@pytest.mark.parametrize("action_set", SOCCER.action_sets)
def test_the_warm_up_searches_with_the_shipped_models(
    action_set: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = SOCCER.library(ROBOT, action_set)
    models = load_models(ROBOT, SOCCER.known_features, action_set=action_set, folder=SOCCER.shipped_models)
    refiner = Refiner(ROBOT, models, ranges=library.ranges)
    refine, answers = refiner.refine, list[Refinement]()
    monkeypatch.setattr(refiner, "refine", lambda world, chain: answers.append(refine(world, chain)))
    warm_up_refinement(library, refiner)
    assert any(answer.curves for answer in answers)
