"""How long the core refinement of a chain takes: search, predictions and gate, without ROS.

Each request of a round is another random situation, so that no cache of the processor flatters the numbers.
As in the node, two cores search where there are two, and what lives as long as the process is not scanned for
garbage. So times are those of a clock on the wall, and hold for an idle machine.
"""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

from ator_ros.compiled import use_cores
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.evaluation.trials import Trial, open_places, open_speeds, random_trial
from ator_ros.refinement.refiner import Refiner
from ator_ros.tools.benchmarks.requests import long_chain
from ator_ros.tools.benchmarks.rows import LongChainTime, RefinementTime
from ator_ros.tops.library import TopLibrary

SEED = 801
WARM_UP = 20
CORES = 2
LIMITS_MS = {"2 steps, heading": 1.0, "3 steps, two headings": 5.0}
"""What must be reached, in ms in the median of the quietest round."""

CASES: dict[str, tuple[int, Callable[[Trial], Any]]] = {
    "2 steps, heading": (0, lambda trial: trial.chain),
    "2 steps, heading and speed": (0, lambda trial: open_speeds(trial.chain)),
    "3 steps, two headings": (-1, lambda trial: trial.chain),
    "3 steps, two headings and speeds": (-1, lambda trial: open_speeds(trial.chain)),
    "3 steps, place, headings and speeds": (-1, lambda trial: open_places(trial.chain)),
}
"""By name: whether the domain's first (0) or last (-1) chain, and what is left open in it."""
LENGTHS = (2, 4, 8, 16, 32)
"""Steps of the chains that show how the time grows."""


def measure(
    source: ToolsetSource, requests: int = 200, rounds: int = 5
) -> dict[str, RefinementTime | LongChainTime]:
    """Return for each case the median and the 99th percentile in ms, and the limit where there is one.

    Beside them are the times of chains of LENGTHS.

    The cases are measured in turn, `rounds` times. On a machine that is shared with others the slowest round
    tells of them, so the quietest one counts; the slowest median is told beside it.
    """
    tools, library = tools_of(source)
    refiner = tools.refiner(gated=True)
    use_cores(CORES)
    names = list(tools.domain.chains)
    trials = [
        [
            random_trial(tools.domain, chain, library, seed=SEED, index=index)
            for index in range(requests + WARM_UP)
        ]
        for chain in (names[0], names[-1])
    ]
    naive = {
        name: [(trial, refiner.naive(trial.world, chain(trial))) for trial in trials[kind]]
        for name, (kind, chain) in CASES.items()
    }
    times: dict[str, list[list[float]]] = {name: [] for name in CASES}
    gc.collect()
    gc.freeze()
    try:
        for _ in range(rounds):
            for name, chains in naive.items():
                times[name].append(_times(refiner, chains))
        growth = _growth(refiner, library, max(rounds, 1))
    finally:
        gc.unfreeze()
        use_cores(1)
    return {**{name: best_round(name, times[name]) for name in CASES}, **growth}


def _growth(refiner: Refiner, library: TopLibrary, rounds: int) -> dict[str, LongChainTime]:
    """Return the time in ms, per step and in all, of chains of LENGTHS with open headings and speeds."""
    chains = {length: long_chain(library, length) for length in LENGTHS}
    times: dict[int, list[float]] = {length: [] for length in LENGTHS}
    for _ in range(rounds):
        for length, (world, chain) in chains.items():
            began = time.perf_counter()
            refiner.refine(world, chain)
            times[length].append(1000.0 * (time.perf_counter() - began))
    return {
        f"{length} steps, headings and speeds": LongChainTime(
            round(min(each), 3), round(min(each) / length, 3)
        )
        for length, each in times.items()
    }


def best_round(name: str, rounds: Sequence[Sequence[float]]) -> RefinementTime:
    """Return the times in ms of a case in its quietest round, and the slowest round's median."""
    quietest = min(rounds, key=statistics.median)
    return RefinementTime(
        median_ms=round(statistics.median(quietest), 3),
        p99_ms=round(statistics.quantiles(quietest, n=100)[-1], 3),
        slowest_median_ms=round(max(map(statistics.median, rounds)), 3),
        limit_ms=LIMITS_MS.get(name),
    )


def _times(refiner: Refiner, requests: Sequence[tuple[Trial, Any]]) -> list[float]:
    """Return the time in ms of each request after the warm-up."""
    times = []
    for trial, chain in requests:
        began = time.perf_counter()
        refiner.refine(trial.world, chain)
        times.append(1000.0 * (time.perf_counter() - began))
    return times[WARM_UP:]
