"""How long the core refinement of a chain takes: search, predictions and gate, without ROS.

Each request of a round is another random situation, so that no cache of the processor flatters the numbers.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

from ator_ros.evaluation.toolset import ToolsetSource, make_library, make_toolset
from ator_ros.evaluation.trials import Trial, open_speeds, random_trial
from ator_ros.refinement.refiner import Refiner

SEED = 801
WARM_UP = 20
LIMITS_MS = {"2 steps, heading": 1.0, "3 steps, two headings": 5.0}
"""What must be reached, in ms in the median of the quietest round."""

CASES: dict[str, tuple[int, Callable[[Trial], Any]]] = {
    "2 steps, heading": (0, lambda trial: trial.chain),
    "2 steps, heading and speed": (0, lambda trial: open_speeds(trial.chain)),
    "3 steps, two headings": (1, lambda trial: trial.chain),
    "3 steps, two headings and speeds": (1, lambda trial: open_speeds(trial.chain)),
}
"""By name: the number of the default domain's chain, and what is left open in it."""


def measure(requests: int = 200, rounds: int = 5) -> dict[str, dict[str, float]]:
    """Return for each case the median and the 99th percentile in ms, and the limit where there is one.

    The cases are measured in turn, `rounds` times. On a machine that is shared with others the slowest round
    tells of them, so the quietest one counts; the slowest median is told beside it.
    """
    source = ToolsetSource()
    tools = make_toolset(source)
    library = make_library(tools.robot, source)
    refiner = tools.refiner(gated=True)
    trials = [
        [
            random_trial(tools.domain, chain, library, seed=SEED, index=index)
            for index in range(requests + WARM_UP)
        ]
        for chain in tools.domain.chains
    ]
    naive = {
        name: [(trial, refiner.naive(trial.world, chain(trial))) for trial in trials[kind]]
        for name, (kind, chain) in CASES.items()
    }
    times: dict[str, list[list[float]]] = {name: [] for name in CASES}
    for _ in range(rounds):
        for name, chains in naive.items():
            times[name].append(_times(refiner, chains))
    return {name: _row(name, times[name]) for name in CASES}


def _row(name: str, rounds: Sequence[Sequence[float]]) -> dict[str, float]:
    quietest = min(rounds, key=statistics.median)
    row = {
        "median_ms": round(statistics.median(quietest), 3),
        "p99_ms": round(statistics.quantiles(quietest, n=100)[-1], 3),
        "slowest_median_ms": round(max(map(statistics.median, rounds)), 3),
    }
    return {**row, "limit_ms": LIMITS_MS[name]} if name in LIMITS_MS else row


def _times(refiner: Refiner, requests: Sequence[tuple[Trial, Any]]) -> list[float]:
    """Return the time in ms of each request after the warm-up."""
    times = []
    for trial, chain in requests:
        began = time.perf_counter()
        refiner.refine(trial.world, chain)
        times.append(1000.0 * (time.perf_counter() - began))
    return times[WARM_UP:]
