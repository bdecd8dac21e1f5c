"""Success rates of chains with realistic sensors, compared with true states in the same situations."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ator_ros.evaluation.chain_run import ChainRun, run_chain
from ator_ros.evaluation.noise_result import ConditionResult
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.evaluation.trials import random_trial
from ator_ros.simulation.sensors import REALISTIC, REALISTIC_SIGHT, SensorConfig, Sensors, Sight
from ator_ros.world.estimation import ObjectTracker
from ator_ros.world.state import World

TRUTH = "truth"
POINTS = 3.0
"""Percentage points by which the success rate may be below that with true states."""
_LATE = SensorConfig(latency=0.1)
_RESAMPLES = 5000
_MOST_REASONS = 8


@dataclass(frozen=True, slots=True)
class SensingCondition:
    """How the executor observes the world.

    Attributes
    ----------
    sensors : SensorConfig
        Errors of the odometry, and the latency.
    sight : Sight
        Errors with which each object is seen.
    tracked : bool
        Whether sightings of objects are filtered, as in the node.
    fetches : int
        Number of times that a lost object may be fetched again.
    foreseen : float
        Time in s by which the executor predicts observed states forward.
    """

    sensors: SensorConfig = field(default_factory=SensorConfig)
    sight: Sight = field(default_factory=Sight)
    tracked: bool = True
    fetches: int = 0
    foreseen: float = 0.0


#: Single errors, late states, all errors; a new condition is a new row.
CONDITIONS: Mapping[str, SensingCondition] = MappingProxyType(
    {
        TRUTH: SensingCondition(),
        "drift": SensingCondition(REALISTIC),
        "noise": SensingCondition(
            sight=Sight(noise=REALISTIC_SIGHT.noise, velocity_noise=REALISTIC_SIGHT.velocity_noise)
        ),
        "delay": SensingCondition(sight=Sight(delay=REALISTIC_SIGHT.delay)),
        "dropouts": SensingCondition(sight=Sight(dropouts=REALISTIC_SIGHT.dropouts)),
        "latency": SensingCondition(_LATE, foreseen=_LATE.latency),
        "latency, 50 ms too much foreseen": SensingCondition(_LATE, foreseen=0.15),
        "latency, 50 ms too little foreseen": SensingCondition(_LATE, foreseen=0.05),
        "latency, not foreseen": SensingCondition(_LATE),
        "all": SensingCondition(REALISTIC, REALISTIC_SIGHT),
        "all and latency": SensingCondition(
            dataclasses.replace(REALISTIC, latency=_LATE.latency), REALISTIC_SIGHT, foreseen=_LATE.latency
        ),
        "all, lost objects fetched": SensingCondition(REALISTIC, REALISTIC_SIGHT, fetches=2),
        "all, untracked": SensingCondition(REALISTIC, REALISTIC_SIGHT, tracked=False),
    }
)


@dataclass(frozen=True)
class NoiseTask:
    """One situation under some conditions: seed, index, chain, policy, conditions, source of the tools."""

    seed: int
    index: int
    chain: str
    policy: str
    conditions: tuple[str, ...]
    source: ToolsetSource = field(default_factory=ToolsetSource)


def execute(task: NoiseTask) -> dict[str, ChainRun]:
    """Execute one situation under each condition; the policy chooses the chain from the true state."""
    tools, library = tools_of(task.source)
    trial = random_trial(tools.domain, task.chain, library, seed=task.seed, index=task.index)
    chain = POLICIES[task.policy](tools, trial).chain
    runs = {}
    for name in task.conditions:
        condition = CONDITIONS[name]
        runs[name] = run_chain(
            tools.robot,
            library,
            trial.world,
            chain,
            observe=_observer(condition, tools.domain.objects, task.seed * 1_000_003 + task.index),
            fetches=condition.fetches,
            latency=condition.foreseen,
        )
    return runs


def _observer(condition: SensingCondition, objects: Sequence[str], seed: int) -> Callable[[World], World]:
    """Return the function from a true state to the estimated one under `condition`."""
    config = dataclasses.replace(condition.sensors, objects=dict.fromkeys(objects, condition.sight))
    sensors, sight = Sensors(config, seed), condition.sight
    noise = sight.noise if condition.tracked else 0.0
    trackers = {name: ObjectTracker(noise, sight.velocity_noise) for name in objects}

    def observe(world: World) -> World:
        believed = sensors.observe(world)
        for name, tracker in trackers.items():
            believed = tracker.observe(believed, name)
        return believed

    return observe


def summarise(results: Sequence[Mapping[str, ChainRun]]) -> tuple[ConditionResult, ...]:
    """Return statistics of the runs of many situations, one result per condition."""
    truth = np.array([runs[TRUTH].success for runs in results])
    return tuple(_result(name, [runs[name] for runs in results], truth) for name in results[0])


def _result(name: str, runs: Sequence[ChainRun], truth: NDArray[np.bool_]) -> ConditionResult:
    success = np.array([run.success for run in runs])
    below = 100.0 * (truth.astype(float) - success)
    draws = np.random.default_rng(0).integers(len(below), size=(_RESAMPLES, len(below)))
    interval = np.percentile(below[draws].mean(axis=1), (2.5, 97.5)).round(2)
    errors = np.array([run.error for run in runs if run.success and np.isfinite(run.error)])
    failures = Counter(_without_numbers(run.reason) for run in runs if not run.success)
    durations = [run.duration for run in runs if run.success]
    return ConditionResult(
        condition=name,
        latency_s=CONDITIONS[name].sensors.latency,
        foreseen_s=CONDITIONS[name].foreseen,
        success_percent=round(100.0 * float(success.mean()), 2),
        points_below_truth=round(float(below.mean()), 2),
        points_below_truth_ci95=tuple(interval.tolist()),
        within_limit=bool(below.mean() <= POINTS),
        mean_duration_s=round(float(np.mean(durations)), 3) if durations else None,
        error_median_m=round(float(np.median(errors)), 4) if errors.size else None,
        error_p95_m=round(float(np.percentile(errors, 95)), 4) if errors.size else None,
        failures=dict(failures.most_common(_MOST_REASONS)),
    )


def _without_numbers(reason: str) -> str:
    return re.sub(r"-?\d+(\.\d+)?", "#", reason)
