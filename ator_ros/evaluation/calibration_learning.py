"""Learning corrections of predicted durations from executed chains; see `refinement.calibration`."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.goal_variables import with_values
from ator_ros.evaluation.policies import UNGATED
from ator_ros.evaluation.statistics import mean_interval
from ator_ros.evaluation.toolset import Models, Toolset
from ator_ros.evaluation.trials import EvaluationError, random_trial
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


class StepExample(NamedTuple):
    """One executed action of a chain.

    Attributes
    ----------
    group : str
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

    group: str
    situation: tuple[int, int]
    action: str
    step: PredictedStep
    actual: float


def step_examples(
    records: Iterable[Mapping[str, Any]], *, seed: int, chain: str, tools: Toolset, library: TopLibrary
) -> list[StepExample]:
    """Return the actions of successful chains in records of `evaluate_trial`."""
    examples: list[StepExample] = []
    models = tools.models
    for record in records:
        trial = random_trial(tools.domain, chain, library, seed=seed, index=record["index"])
        for policy in ("naive", *UNGATED):  # the gated ones execute the same chains
            row = record["policies"].get(policy)
            if row is None or not row["success"]:
                continue
            chosen, actual = _as_chosen(trial.chain, row["chosen"]), row["actions"]
            if len(actual) != len(chosen.calls):
                continue  # a lost object was fetched again by further actions
            prediction = predict_chain(trial.world, chosen, models, tools.robot)
            steps = chain_steps(prediction, chosen, trial.world, models, tools.robot)
            examples += [
                StepExample(f"{chain} {policy}", (seed, record["index"]), call.top.action, step, float(took))
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


def fit_calibration(
    examples: Sequence[StepExample],
    models: Models,
    *,
    actions: Sequence[str] | None = None,
    kept: Mapping[str, Shortfall] = MappingProxyType({}),
) -> Calibration:
    """Fit the shortfall of each action by least squares over all its executions.

    With `actions` only theirs are fitted, and the shortfalls of others are those `kept`.

    Raises
    ------
    EvaluationError
        Every action, or one of `actions`, has too few examples.
    """
    shortfalls: dict[str, Shortfall] = {}
    for action in sorted({example.action for example in examples}):
        of_action = [example for example in examples if example.action == action]
        if len({example.situation for example in of_action}) >= LEAST_SITUATIONS:
            shortfalls[action] = _fit(of_action, model_digest(models.get(action)))
    if not shortfalls:
        got = len({example.situation for example in examples})
        raise EvaluationError(f"expected chains of at least {LEAST_SITUATIONS} situations, got {got}")
    if actions is None:
        return Calibration(shortfalls)
    if missing := set(actions) - shortfalls.keys():
        raise EvaluationError(f"--actions: {min(missing)}: expected chains of more situations, got too few")
    return Calibration({**kept, **{name: shortfalls[name] for name in actions}})


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
    examples: Sequence[StepExample], models: Models, **others: Any
) -> dict[str, dict[str, Any]]:
    """Return the mean errors of predicted chain durations, cross-validated over situations.

    Parameters
    ----------
    examples, models, others
        See `fit_calibration`.

    Returns
    -------
    dict
        By "CHAIN POLICY": "chains", their number; "raw_s" and "corrected_s", mean of predicted minus actual
        in s; "raw_ci95" and "corrected_ci95", 95 % intervals; "raw_mae_s" and "corrected_mae_s", mean
        absolute errors in s.
    """
    situations = sorted({example.situation for example in examples})
    order = np.random.default_rng(0).permutation(len(situations))
    sums: dict[str, dict[tuple[int, int], tuple[float, float]]] = defaultdict(dict)
    for fold in range(FOLDS):
        held_out = {situations[number] for number in order[fold::FOLDS]}
        rest = [example for example in examples if example.situation not in held_out]
        calibration = fit_calibration(rest, models, **others)
        for example in (example for example in examples if example.situation in held_out):
            error = example.step.predicted - example.actual
            shortfall = calibration.shortfalls.get(example.action)
            added = 0.0 if shortfall is None else shortfall.of(example.step)
            raw, corrected = sums[example.group].get(example.situation, (0.0, 0.0))
            sums[example.group][example.situation] = raw + error, corrected + error + added
    judged: dict[str, dict[str, Any]] = {}
    for group, errors in sums.items():
        judged[group] = {"chains": len(errors)}
        for name, column in zip(("raw", "corrected"), zip(*errors.values(), strict=True), strict=True):
            values = np.array(column)
            judged[group] |= {
                f"{name}_s": round(math.fsum(values) / len(values), 4),
                f"{name}_ci95": mean_interval(values),
                f"{name}_mae_s": round(float(np.abs(values).mean()), 4),
            }
    return judged
