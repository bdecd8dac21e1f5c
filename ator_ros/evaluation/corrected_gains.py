"""What a gate sees of executed chains once it judges corrected predictions."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from ator_ros.evaluation.calibration_learning import FOLDS, StepExample, fit_calibration
from ator_ros.evaluation.gate_learning import KINDS
from ator_ros.evaluation.policies import POLICIES, Toolset
from ator_ros.evaluation.trials import random_trial
from ator_ros.tops.library import TopLibrary


def with_corrected_gains(
    records: Sequence[Mapping[str, Any]],
    examples: Sequence[StepExample],
    *,
    seed: int,
    chain: str,
    tools: Toolset,
    library: TopLibrary,
) -> list[dict[str, Any]]:
    """Return records of `evaluate_trial` with the features that a gate sees of corrected predictions.

    The correction of a situation is learned from the others, so that its errors are those of new chains.

    Parameters
    ----------
    records : sequence
        Of the `chain` in situations of this `seed`, which the same models have chosen.
    examples : sequence of StepExample
        The actions that the records executed.
    tools : Toolset
        With a gate that judges corrected predictions.
    library : TopLibrary
        Robot, and TOPs of the chain.

    Raises
    ------
    EvaluationError
        There are too few examples to learn a correction from.
    """
    seen = [dict(record) for record in records]
    for fold in range(FOLDS):
        held_out = seen[fold::FOLDS]
        without = {(seed, record["index"]) for record in held_out}
        rest = [example for example in examples if example.situation not in without]
        corrected = dataclasses.replace(tools, calibration=fit_calibration(rest, tools.models["learned"]))
        for record in held_out:
            trial = random_trial(tools.domain, chain, library, seed=seed, index=record["index"])
            for policy, key in KINDS:
                refinement = POLICIES[policy](corrected, trial).refinement if record.get(key) else None
                if refinement is not None:
                    record[key] = dict(refinement.features)
    return seen
