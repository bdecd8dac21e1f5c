"""The runs of an evaluation in which refinement did worst, to look at them again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.storage import RESULT, read_result, to_records
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.robot.description import Robot

_NAIVE = "naive"
_REFINED = ("gated", "refined")
"""Policies that refine; the first that an evaluation has is looked at."""
_MOST = 20


def worst_trials(folder: Path, domain: Domain, robot: Robot) -> tuple[tuple[str, Trial], ...]:
    """Return situations of an evaluation by the loss against the naive chain, the greatest first.

    Parameters
    ----------
    folder : Path
        Holds `evaluation.json`.
    domain, robot : Domain, Robot
        What was evaluated.

    Returns
    -------
    tuple of (str, Trial)
        A label with the times, and the situation; failures of the refined chain come first.

    Raises
    ------
    EvaluationError
        There is no evaluation of this domain with naive and refined chains.
    """
    result = read_result(folder / RESULT)
    settings, count = result["settings"], result["summary"]["situations"]
    refined = next((name for name in _REFINED if name in result["runs"].get("policies", {})), None)
    if refined is None or _NAIVE not in result["runs"]["policies"]:
        raise EvaluationError(f"{folder / RESULT}: expected naive and refined chains, got neither or one")
    if settings["chain"] not in domain.chains:
        raise EvaluationError(
            f"{folder / RESULT}: chain: expected one of {', '.join(domain.chains)} of the domain "
            f"{domain.name}, got {settings['chain']!r}"
        )
    records = to_records(result["runs"], count)
    library = domain.library(robot, settings["source"]["action_set"])
    ordered = sorted(records, key=lambda record: -_loss(record, refined))[:_MOST]
    return tuple(
        (
            _label(record, refined),
            random_trial(domain, settings["chain"], library, seed=settings["seed"], index=record["index"]),
        )
        for record in ordered
    )


def _loss(record: Mapping[str, Any], refined: str) -> float:
    """Return by how many s the refined chain was slower; infinite where it failed."""
    policies = record["policies"]
    if not policies[refined]["success"]:
        return math.inf
    return float(policies[refined]["duration"] - policies[_NAIVE]["duration"])


def _label(record: Mapping[str, Any], refined: str) -> str:
    loss = _loss(record, refined)
    told = "failed" if math.isinf(loss) else f"{loss:+.2f} s"
    return f"situation {record['index']}: {told} against {record['policies'][_NAIVE]['duration']:.2f} s"
