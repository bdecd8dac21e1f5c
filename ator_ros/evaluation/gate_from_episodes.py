"""Learning a gate from the episodes from which the models were learned, without executing chains.

Cross-fitted: models of one half of the episodes choose chains, and models of the other half judge them, as
their errors are independent. Prediction errors of each half's models on the other half's episodes are
resampled, in units of the predicted spread: the less certain a model, the larger the error.

The widths of averages (`ator_ros.refinement.search`) cannot be learned like that, since both halves share the
errors of their features. `usual_widths` were best in executed situations of development seeds.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import pandas as pd

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.gate_learning import GateExamples, LearnedGates, fit_threshold, learn_gates
from ator_ros.evaluation.policies import reopened
from ator_ros.evaluation.trials import Trial, open_speeds, random_trial
from ator_ros.geometry import FloatArray
from ator_ros.performance.features import OBSERVED, Feature
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import LEAST_EPISODES, TrainingError, direct_of, observed_model
from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.refinement.gate import FEATURES, OpenGate, ThresholdGate
from ator_ros.refinement.objective import expected_time
from ator_ros.refinement.refiner import Refiner
from ator_ros.refinement.search import Widths
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ranges import USUAL_RANGES, Ranges
from ator_ros.world.state import CONTROL_PERIOD

DRAWS = 20
"""Errors drawn for each judgement."""
_YAW = math.radians(6.0)
_SPEED = 0.05  # of the robot's greatest speed
KEPT = 0.85
"""Least share of the judged gain that the gate keeps.

Of the executed gain it then keeps 92 or 93 % (development seeds), since the models of all episodes are better
than those of the halves.
"""
Halves = tuple[Mapping[str, PerformanceModel], Mapping[str, PerformanceModel]]


class CrossFit:
    """Models of both halves of the episodes, and the errors of each on the other half.

    Parameters
    ----------
    robot : Robot
        The robot.
    rows : mapping
        Rows of an experience table by action.
    features : mapping of str to tuple of Feature
        Candidate features by action.
    ranges : mapping, optional
        Goal variable to its range.
    failure_cost : float
        Time in s that one failure costs.
    """

    def __init__(
        self,
        robot: Robot,
        rows: Mapping[str, pd.DataFrame],
        features: Mapping[str, tuple[Feature, ...]],
        ranges: Ranges = USUAL_RANGES,
        failure_cost: float = 0.0,
    ) -> None:
        self.robot, self.ranges, self.failure_cost = robot, ranges, failure_cost
        parts = {action: _halves(table) for action, table in rows.items()}
        first, second = (
            {
                action: observed_model(action, part[half], robot, features[action])
                for action, part in parts.items()
            }
            for half in (0, 1)
        )
        self.models: Halves = (first, second)
        self._errors = {
            action: np.concatenate([_errors(first[action], part[1]), _errors(second[action], part[0])])
            for action, part in parts.items()
        }

    def examples(self, trials: list[Trial], *, seed: int, widths: Widths | None = None) -> GateExamples:
        """Return the expected gain of refinement in each of `trials`, with and without speeds.

        Parameters
        ----------
        trials : list of Trial
            The situations.
        seed : int
            Seed of the drawn errors.
        widths : mapping, optional
            Widths of averages of costs; by default none.
        """
        rng, gate = np.random.default_rng(seed), OpenGate(widths=widths or {})
        rows = (row for trial in trials for row in self._of_trial(trial, gate, rng))
        return GateExamples(*(np.array(column) for column in zip(*rows, strict=True)))

    def _of_trial(
        self, trial: Trial, gate: OpenGate, rng: np.random.Generator
    ) -> Iterator[tuple[list[float], float, float, int, int]]:
        for chooser, judge in (self.models, self.models[::-1]):
            refiner = Refiner(self.robot, chooser, gate, ranges=self.ranges, failure_cost=self.failure_cost)
            naive = refiner.naive(trial.world, open_speeds(trial.chain))
            for kind, plan in enumerate((trial.chain, open_speeds(trial.chain))):
                refinement = refiner.refine(trial.world, reopened(naive, plan))
                values = [refinement.features.get(name, 0.0) for name in FEATURES]
                before = self._judged(trial, naive, judge, rng)
                after = self._judged(trial, refinement.chain, judge, rng)
                for times in zip(before, after, strict=True):
                    yield values, *times, trial.index, kind

    def _judged(
        self, trial: Trial, chain: TopChain, judge: Mapping[str, PerformanceModel], rng: np.random.Generator
    ) -> list[float]:
        """Return `DRAWS` costs of a chain: the judge's prediction and drawn errors."""
        objective = expected_time(self.failure_cost)
        prediction = predict_chain(trial.world, chain, judge, self.robot, objective)
        late = np.zeros(DRAWS)
        for call, action in zip(chain.calls, prediction.actions, strict=True):
            late += rng.choice(self._errors[call.top.action], DRAWS) * action.get("spread", 0.0)
        costs: list[float] = (prediction.cost + late).tolist()
        return costs


def usual_widths(robot: Robot) -> dict[str, float]:
    """Return the widths of averages of observed models' costs, see `ator_ros.refinement.search`."""
    return {"yaw": round(_YAW, 4), "speed": round(_SPEED * robot.limits.v, 4)}


def learn_from_episodes(
    fitted: CrossFit, trials: list[Trial], *, seed: int, widths: Widths | None = None
) -> tuple[ThresholdGate, LearnedGates]:
    """Return the gate of models and its comparison; `widths` is as in `CrossFit.examples`.

    The gate is always the threshold: it grows with the spread, so it also holds for models that are learned
    later from more or fewer episodes. It is at least one `CONTROL_PERIOD`, the resolution of executed chains.
    """
    widths = usual_widths(fitted.robot) if widths is None else widths
    examples = fitted.examples(trials, seed=seed, widths=widths)
    learned = learn_gates(examples, partial(fit_threshold, keep=KEPT))
    comparison = {kind: _per_chain(judged) for kind, judged in learned.comparison.items()}
    gain = max(learned.threshold.gain, CONTROL_PERIOD)
    gate = dataclasses.replace(learned.threshold, gain=gain, widths=widths)
    return gate, learned._replace(comparison=comparison)


def _per_chain(judged: Mapping[str, float]) -> dict[str, float]:
    """Return the comparison of a gate with sums over chains instead of drawn errors."""
    sums = {name: round(judged[name] / DRAWS) for name in ("higher", "equal", "lower")}
    return {**judged, **sums, "utility": round(judged["utility"] / DRAWS, 3)}


def gate_of_episodes(
    domain: Domain,
    library: TopLibrary,
    rows: Mapping[str, pd.DataFrame],
    chain: str,
    *,
    seed: int,
    situations: int,
    features: Mapping[str, tuple[Feature, ...]] | None = None,
) -> tuple[ThresholdGate, LearnedGates]:
    """Learn the gate of models from tables of episodes, as `learn_from_episodes` says.

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
    features : mapping of str to tuple of Feature, optional
        Candidate features of the models by action; by default those of observed models. Costs are averaged,
        see `usual_widths`, unless the features include ideal times.

    Raises
    ------
    TrainingError
        Too few episodes of an action have succeeded.
    """
    trials = [random_trial(domain, chain, library, seed=seed, index=index) for index in range(situations)]
    actions = {call.top.action for call in trials[0].chain.calls}
    used = {action: table for action, table in rows.items() if action in actions}
    _require_enough(used)
    known = {action: (features or {}).get(action, OBSERVED) for action in used}
    fitted = CrossFit(library.robot, used, known, domain.ranges, domain.time_limit)
    described = any(feature.ideal for names in known.values() for feature in names)
    return learn_from_episodes(fitted, trials, seed=seed, widths={} if described else None)


def _require_enough(rows: Mapping[str, pd.DataFrame]) -> None:
    for action, table in rows.items():
        succeeded = table.loc[table["success"], "episode"].nunique()
        if succeeded < 2 * LEAST_EPISODES:
            raise TrainingError(
                f"{action}: expected at least {2 * LEAST_EPISODES} episodes that succeeded, as models of "
                f"each half judge those of the other, got {succeeded}"
            )


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
