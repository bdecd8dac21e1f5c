"""The situations of an evaluation in which refinement lost most, executed once more for their paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import POLICIES, Toolset
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.evaluation.toolset import make_library
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.tops.library import TopLibrary

MOST = 5
"""Situations that are executed once more."""


@dataclass(frozen=True, slots=True)
class WorstRun:
    """A situation in which the refined chain was slower than the naive one.

    Attributes
    ----------
    record : dict
        The situation's record in the evaluation.
    trial : Trial
        Start and plan.
    runs : mapping
        By policy "path" (rows that begin with x, y in m), "heading" (rad) at the first goal, and "duration"
        (s).
    """

    record: Record
    trial: Trial
    runs: Mapping[str, Mapping[str, Any]]


def policy_shown(settings: Settings) -> str:
    """Return the policy whose losses are shown: the gated one, if it was evaluated."""
    return next((name for name in ("gated", "refined") if name in settings.policies), "naive")


def worst_runs(records: Sequence[Record], tools: Toolset, settings: Settings) -> tuple[WorstRun, ...]:
    """Execute the naive and the refined chain again in the situations of the greatest losses."""
    policy = policy_shown(settings)
    library = make_library(tools.robot, settings.source)
    losses = [r["policies"][policy]["duration"] - r["policies"]["naive"]["duration"] for r in records]
    order = sorted(range(len(records)), key=lambda index: -losses[index])
    worst = [records[index] for index in order[:MOST] if losses[index] > 0.0]
    return tuple(_executed(record, policy, library, tools, settings) for record in worst)


def _executed(
    record: Record, policy: str, library: TopLibrary, tools: Toolset, settings: Settings
) -> WorstRun:
    trial = random_trial(tools.domain, settings.chain, library, seed=settings.seed, index=record["index"])
    limit = tools.domain.time_limit
    runs = {}
    for name in ("naive", policy):
        chain = POLICIES[name](tools, trial).chain
        run = run_chain(tools.robot, library, trial.world, chain, keep_path=True, time_limit=limit)
        runs[name] = {"path": run.path, "heading": chain.calls[0].goal.pose.yaw, "duration": run.duration}
    return WorstRun(record, trial, runs)
