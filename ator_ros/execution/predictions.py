"""Predictions of chains that are executed as they are."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ator_ros.refinement.calibration import Calibration, chosen_headings
from ator_ros.refinement.chain_model import ChainPrediction, predict_chain
from ator_ros.refinement.free_variables import PredictsPerformance
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World


def remaining(prediction: ChainPrediction, step: int, since: float) -> float:
    """Return the predicted time in s to a chain's end, `since` s after `step` (from 0) has begun."""
    current, *rest = (action.get("duration", math.nan) for action in prediction.actions[step:])
    return max(0.0, current - since) + sum(rest)


class Predictor:
    """Predicts chains and their actions.

    Parameters
    ----------
    robot : Robot
        Sizes and limits.
    models : mapping
        Action name to performance model; chains with other actions are not predicted.
    calibration : Calibration, optional
        Corrections of the models' predictions.
    """

    def __init__(
        self,
        robot: Robot,
        models: Mapping[str, PredictsPerformance],
        calibration: Calibration | None = None,
    ) -> None:
        self._robot = robot
        self._models = models
        self._calibration = (calibration or Calibration()).matching(models)

    def chain(self, world: World, chain: TopChain) -> ChainPrediction | None:
        """Predict `chain` from the state `world`; None where an action has no model."""
        if any(call.top.action not in self._models for call in chain.calls):
            return None
        prediction = predict_chain(world, chain, self._models, self._robot)
        return self._calibration.corrected([(chain, prediction)], world, self._models, self._robot)[0]

    def action(self, world: World, chain: TopChain, step: int) -> Mapping[str, float] | None:
        """Predict one step (from 0) of `chain` from the state `world`; None where it has no model.

        The whole chain decides whether the step's heading is free: other steps may bind it.
        """
        part = TopChain((chain.calls[step],))
        if part.calls[0].top.action not in self._models:
            return None
        prediction = predict_chain(world, part, self._models, self._robot)
        chosen = chosen_headings(chain, self._models, self._robot)[step : step + 1]
        (corrected,) = self._calibration.corrected(
            [(part, prediction)], world, self._models, self._robot, chosen=chosen
        )
        return corrected.actions[0]
