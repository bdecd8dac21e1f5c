"""Predicted durations of steps from several situations, as one request."""

from __future__ import annotations

import numpy as np
import pytest
from refinement_fakes import ANGLE, ROBOT, FakeModel, call, turning_time, world

from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.refinement.durations import predict_durations
from ator_ros.tops.chain import TopChain

WORLDS = [world(x=-1.0), world(x=1.0, y=0.5), world(y=-1.0)]
CALLS = [call("goToPose", 1.0, 0.0, 0.0), call("shoot", 2.0, 0.0, 0.0), call("goToPose", 0.0, 1.0, 1.0)]


def test_each_step_is_predicted_from_each_situation_as_in_a_chain() -> None:
    models = {"goToPose": FakeModel(turning_time, ANGLE)}
    found = predict_durations(WORLDS, CALLS, ROBOT, models)
    for row, start in enumerate(WORLDS):
        for column in (0, 2):
            chain = predict_chain(start, TopChain((CALLS[column],)), models, ROBOT)
            assert found.durations[row, column] == pytest.approx(chain.duration)
            assert found.spreads[row, column] == pytest.approx(chain.spread)
            assert found.success[row, column] == pytest.approx(chain.actions[0]["success"])


def test_a_step_without_a_model_is_not_predicted() -> None:
    found = predict_durations(WORLDS, CALLS, ROBOT, {})
    assert np.isnan(found).all()
    assert found.durations.shape == (3, 3)
