"""Learning a gate from the episodes from which the models were learned, without executing chains.

Cross-fitted: models of one half of the episodes choose chains, and models of the other half judge them, as
their errors are independent. Prediction errors of each half's models on the other half's episodes are
resampled, in units of the predicted spread: the less certain a model, the larger the error.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.gate_learning import GateExamples, fit_threshold
from ator_ros.evaluation.policies import reopened
from ator_ros.evaluation.trials import Trial, open_speeds, random_trial
from ator_ros.experience.table import ExperienceError
from ator_ros.geometry import FloatArray
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import LEAST_EPISODES, direct_of, train
from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.refinement.gate import FEATURES, ThresholdGate
from ator_ros.refinement.objective import expected_time
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import CONTROL_PERIOD

DRAWS = 20
"""Errors drawn for each judgment."""
KEPT = 0.85
"""Least share of the judged gain that the gate keeps.

Of the executed gain it then keeps 92 or 93 % (development seeds), since the models of all episodes are better
than those of the halves.
"""
_Models = Mapping[str, PerformanceModel]


def gate_of_episodes(
    domain: Domain,
    library: TopLibrary,
    rows: Mapping[str, pd.DataFrame],
    chain: str,
    *,
    seed: int,
    situations: int,
) -> ThresholdGate:
    """Learn the gate of models from tables of episodes.

    The threshold grows with the spread, so it also holds for models that are learned later from more or fewer
    episodes. It is at least one `CONTROL_PERIOD`, the resolution of executed chains.

    Parameters
    ----------
    domain, library
        Source of the chains, and their TOPs for one robot.
    rows : mapping of str to DataFrame
        Experience by action; actions that are not in the chain are ignored.
    chain : str
        Name of the domain's chain.
    seed, situations : int
        Seed and number of the situations in which chains are chosen.

    Raises
    ------
    ExperienceError
        Too few episodes of an action have succeeded.
    """
    trials = [random_trial(domain, chain, library, seed=seed, index=index) for index in range(situations)]
    actions = {call.top.action for call in trials[0].chain.calls}
    used = {action: table for action, table in rows.items() if action in actions}
    for action, table in used.items():
        succeeded = table.loc[table["success"], "episode"].nunique()
        if succeeded < 2 * LEAST_EPISODES:
            raise ExperienceError(
                f"{action}: expected at least {2 * LEAST_EPISODES} episodes that succeeded, as models of "
                f"each half judge those of the other, got {succeeded}"
            )
    examples = _CrossFit(domain, library, used).examples(trials, seed)
    gate = fit_threshold(examples, keep=KEPT)
    return dataclasses.replace(gate, gain=max(gate.gain, CONTROL_PERIOD))


class _CrossFit:
    """Models of both halves of the episodes, and the errors of each on the other half."""

    def __init__(self, domain: Domain, library: TopLibrary, rows: Mapping[str, pd.DataFrame]) -> None:
        self._robot, self._failure_cost = library.robot, domain.time_limit
        features = {action: domain.candidates(action, library.action_set) for action in rows}
        parts = {action: _halves(table) for action, table in rows.items()}
        first, second = (
            {
                action: train(action, part[half], self._robot, features=features[action])
                for action, part in parts.items()
            }
            for half in (0, 1)
        )
        self._judges = (second, first)
        self._refiners = [
            Refiner(self._robot, models, ranges=domain.ranges, failure_cost=domain.time_limit)
            for models in (first, second)
        ]
        self._errors = {
            action: np.concatenate([_errors(first[action], part[1]), _errors(second[action], part[0])])
            for action, part in parts.items()
        }

    def examples(self, trials: list[Trial], seed: int) -> GateExamples:
        """Return the expected gain of refinement in each of `trials`, with and without speeds."""
        rng = np.random.default_rng(seed)
        return GateExamples.of(row for trial in trials for row in self._of_trial(trial, rng))

    def _of_trial(self, trial: Trial, rng: np.random.Generator) -> Iterator[tuple[Any, ...]]:
        for refiner, judge in zip(self._refiners, self._judges, strict=True):
            naive = refiner.naive(trial.world, open_speeds(trial.chain))
            for kind, plan in enumerate((trial.chain, open_speeds(trial.chain))):
                refinement = refiner.refine(trial.world, reopened(naive, plan))
                values = [refinement.features.get(name, 0.0) for name in FEATURES]
                before = self._judged(trial, naive, judge, rng)
                after = self._judged(trial, refinement.chain, judge, rng)
                for times in zip(before, after, strict=True):
                    yield values, *times, kind

    def _judged(self, trial: Trial, chain: TopChain, judge: _Models, rng: np.random.Generator) -> list[float]:
        """Return `DRAWS` costs of a chain: the judge's prediction and drawn errors."""
        prediction = predict_chain(trial.world, chain, judge, self._robot, expected_time(self._failure_cost))
        late = np.zeros(DRAWS)
        for call, action in zip(chain.calls, prediction.actions, strict=True):
            late += rng.choice(self._errors[call.top.action], DRAWS) * action.get("spread", 0.0)
        costs: list[float] = (prediction.cost + late).tolist()
        return costs


def _halves(rows: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    even = rows["episode"].isin(rows["episode"].unique()[::2])
    return rows[even], rows[~even]


def _errors(model: PerformanceModel, rows: pd.DataFrame) -> FloatArray:
    """Return actual less predicted durations of successful episodes, in units of the predicted spread."""
    starts = rows[(rows["t"] == 0.0) & rows["success"]]
    predicted = model.predict(direct_of(starts), ("duration", "spread"))
    assert predicted.duration is not None
    assert predicted.spread is not None
    late: FloatArray = starts["duration"].to_numpy(dtype=float) - predicted.duration
    return np.divide(late, predicted.spread, out=np.zeros_like(late), where=predicted.spread > 0.0)
