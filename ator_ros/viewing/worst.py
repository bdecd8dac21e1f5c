"""The runs of an evaluation in which refinement did worst, to look at them again."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.running import RESULT, read_result
from ator_ros.evaluation.trials import EvaluationError, Trial, random_trial
from ator_ros.robot.description import Robot
from ator_ros.schema import Within, require, structured

_NAIVE = "naive"
_REFINED = ("gated", "refined")
"""Policies that refine; the first that an evaluation has is looked at."""
_MOST = 20
_MOST_SEED = 2**32 - 1  # numpy's


@dataclass(frozen=True)
class _Executed:
    """Duration in s and success of a policy by situation, None where it was not executed."""

    duration: list[float | None]
    success: list[bool | None]


@dataclass(frozen=True)
class _Runs:
    index: list[Annotated[int, Within(0, _MOST_SEED)]]
    policies: dict[str, _Executed]


@dataclass(frozen=True)
class _Source:
    action_set: str


@dataclass(frozen=True)
class _Settings:
    seed: Annotated[int, Within(0, _MOST_SEED)]
    chain: str
    source: _Source


@dataclass(frozen=True)
class _Evaluation:
    """The fields of an evaluation that are needed."""

    settings: _Settings
    runs: _Runs


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
    file = folder / RESULT
    result = read_result(file)
    try:
        evaluation = structured(result, _Evaluation)
        runs, settings = evaluation.runs, evaluation.settings
        for field, there, known in (
            ("settings.chain", settings.chain, domain.chains),
            ("settings.source.action_set", settings.source.action_set, domain.action_sets),
        ):
            require(there in known, field, f"one of {', '.join(known)} of the domain {domain.name}", there)
        losses = list(_losses(runs))
    except ValueError as error:
        raise EvaluationError(f"{file}: {error}") from error
    library = domain.library(robot, settings.source.action_set)
    return tuple(
        (label, random_trial(domain, settings.chain, library, seed=settings.seed, index=index))
        for _, index, label in sorted(losses, key=lambda loss: -loss[0])[:_MOST]
    )


def _losses(runs: _Runs) -> Iterator[tuple[float, int, str]]:
    """Yield by how many s the refined chain was slower, infinite where it failed; index and label."""
    refined = next((name for name in _REFINED if name in runs.policies), None)
    both = refined is not None and _NAIVE in runs.policies
    require(both, "runs.policies", f"{_NAIVE} and one of {', '.join(_REFINED)}", list(runs.policies))
    assert refined is not None
    naive, other = runs.policies[_NAIVE], runs.policies[refined]
    columns = (runs.index, naive.duration, other.duration, other.success)
    lengths = [len(column) for column in columns]
    require(len(set(lengths)) == 1, "runs", "columns of one length", lengths)
    for index, before, after, success in zip(*columns, strict=True):
        if before is None or after is None or not (math.isfinite(before) and math.isfinite(after)):
            continue
        loss = after - before if success else math.inf
        told = f"{loss:+.2f} s" if success else "failed"
        yield loss, index, f"situation {index}: {told} against {before:.2f} s"
