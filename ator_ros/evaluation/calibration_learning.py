"""Learning corrections of predicted durations from executed chains; see `refinement.calibration`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ator_ros.actions.goal_variables import with_values
from ator_ros.evaluation.policies import UNGATED
from ator_ros.evaluation.statistics import mean_interval
from ator_ros.evaluation.toolset import Models, Toolset
from ator_ros.evaluation.trials import EvaluationError, random_trial
from ator_ros.geometry import FloatArray
from ator_ros.refinement.calibration import (
    TERMS,
    Calibration,
    PredictedStep,
    Shortfall,
    chain_steps,
    model_digest,
    terms_of,
)
from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary

LEAST_SITUATIONS = 20
FOLDS = 10


@dataclass(frozen=True)
class StepExample:
    """One executed action of a chain.

    Attributes
    ----------
    chain, policy : str
        Names of the chain and of the policy that chose it.
    situation : (int, int)
        Seed and index of the situation; all chains of a situation share their start.
    action : str
        Name of the action.
    step : PredictedStep
        Its prediction, and what else is known before the execution.
    actual : float
        Actual duration in s.
    """

    chain: str
    policy: str
    situation: tuple[int, int]
    action: str
    step: PredictedStep
    actual: float


def step_examples(
    records: Iterable[Mapping[str, Any]], *, seed: int, chain: str, tools: Toolset, library: TopLibrary
) -> list[StepExample]:
    """Return the actions of successful chains in records of `evaluate_trial`.

    Raises
    ------
    EvaluationError
        The records lack the durations of actions.
    """
    examples: list[StepExample] = []
    models = tools.models
    for record in records:
        trial = random_trial(tools.domain, chain, library, seed=seed, index=record["index"])
        for policy in ("naive", *UNGATED):  # the gated ones execute the same chains
            row = record["policies"].get(policy)
            if row is None or not row["success"]:
                continue
            chosen = _as_chosen(trial.chain, row["chosen"])
            actual = row.get("actions")
            if not isinstance(actual, list):
                raise EvaluationError("expected records with the durations of all actions: evaluate again")
            if len(actual) != len(chosen.calls):
                continue  # a lost object was fetched again by further actions
            prediction = predict_chain(trial.world, chosen, models, tools.robot)
            (steps,) = chain_steps([(chosen, prediction)], trial.world, models, tools.robot)
            examples += [
                StepExample(chain, policy, (seed, record["index"]), call.top.action, step, float(took))
                for call, step, took in zip(chosen.calls, steps, actual, strict=True)
                if step is not None
            ]
    return examples


def _as_chosen(chain: TopChain, chosen: Sequence[Sequence[float]]) -> TopChain:
    for index, (yaw, speed, *declared) in enumerate(chosen):
        goal = chain.calls[index].goal
        values = {"yaw": yaw, "speed": speed, **dict(zip(goal.values, declared, strict=True))}
        chain = chain.with_goal(index, with_values(goal, values))
    return chain


def fit_calibration(examples: Sequence[StepExample], models: Models) -> Calibration:
    """Fit the shortfall of each action by least squares over all its executions.

    Raises
    ------
    EvaluationError
        Every action has too few examples.
    """
    shortfalls: dict[str, Shortfall] = {}
    for action in sorted({example.action for example in examples}):
        of_action = [example for example in examples if example.action == action]
        if len({example.situation for example in of_action}) >= LEAST_SITUATIONS:
            shortfalls[action] = _fit(of_action, model_digest(models.get(action)))
    if not shortfalls:
        got = len({example.situation for example in examples})
        raise EvaluationError(f"expected chains of at least {LEAST_SITUATIONS} situations, got {got}")
    return Calibration(shortfalls)


def _fit(examples: Sequence[StepExample], model: str) -> Shortfall:
    table = np.array([list(terms_of(example.step).values()) for example in examples])
    missed = np.array([example.actual - example.step.predicted for example in examples])
    varies = np.ptp(table, axis=0) > 0.0
    design = np.column_stack([np.ones(len(table)), table[:, varies]])
    (constant, *slopes), *_ = np.linalg.lstsq(design, missed, rcond=None)
    names = [name for name, used in zip(TERMS, varies, strict=True) if used]
    fitted = design @ np.array([constant, *slopes])
    return Shortfall(
        float(constant),
        {name: float(slope) for name, slope in zip(names, slopes, strict=True)},
        float(fitted.min()),
        float(fitted.max()),
        model,
    )


def cross_validated(
    examples: Sequence[StepExample],
    models: Models,
    finish: Callable[[Calibration], Calibration] = lambda fitted: fitted,
) -> dict[str, dict[str, Any]]:
    """Return the mean errors of predicted chain durations, cross-validated over situations.

    Parameters
    ----------
    examples, models
        See `fit_calibration`.
    finish : callable, optional
        Returns the calibration that is used, from a fitted one.

    Returns
    -------
    dict
        By "CHAIN POLICY": "chains", their number; "raw_s" and "corrected_s", mean of predicted minus actual
        in s; "raw_ci95" and "corrected_ci95", 95 % intervals; "raw_mae_s" and "corrected_mae_s", mean
        absolute errors in s.
    """
    situations = sorted({example.situation for example in examples})
    order = np.random.default_rng(0).permutation(len(situations))
    raw: dict[tuple[str, str, tuple[int, int]], float] = {}
    corrected: dict[tuple[str, str, tuple[int, int]], float] = {}
    for fold in range(FOLDS):
        held_out = {situations[number] for number in order[fold::FOLDS]}
        rest = [example for example in examples if example.situation not in held_out]
        calibration = finish(fit_calibration(rest, models))
        for example in examples:
            if example.situation in held_out:
                key = (example.chain, example.policy, example.situation)
                error = example.step.predicted - example.actual
                shortfall = calibration.shortfalls.get(example.action)
                added = 0.0 if shortfall is None else shortfall.of(example.step)
                raw[key] = raw.get(key, 0.0) + error
                corrected[key] = corrected.get(key, 0.0) + error + added
    groups = dict.fromkeys((chain, policy) for chain, policy, _ in raw)
    return {
        f"{chain} {policy}": _judged(_of(raw, chain, policy), _of(corrected, chain, policy))
        for chain, policy in groups
    }


def _of(errors: Mapping[tuple[str, str, tuple[int, int]], float], chain: str, policy: str) -> FloatArray:
    return np.array([error for key, error in errors.items() if key[:2] == (chain, policy)])


def _judged(raw: FloatArray, corrected: FloatArray) -> dict[str, Any]:
    return {
        "chains": len(raw),
        "raw_s": round(math.fsum(raw) / len(raw), 4),
        "raw_ci95": mean_interval(raw),
        "raw_mae_s": round(float(np.abs(raw).mean()), 4),
        "corrected_s": round(math.fsum(corrected) / len(corrected), 4),
        "corrected_ci95": mean_interval(corrected),
        "corrected_mae_s": round(float(np.abs(corrected).mean()), 4),
    }
