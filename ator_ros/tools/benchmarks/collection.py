"""How fast experience is collected: with one process and with a worker on each of two cores."""

from __future__ import annotations

import os
import statistics
import time

from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.experience.collect import collect
from ator_ros.tools.benchmarks.rows import CollectionTime

ACTIONS = 2
"""How many of the domain's actions are collected: the first ones."""
SEED = 803
WORKERS = 2
WHOLE = 1000
"""Episodes of each action in a whole collection."""
LIMIT_S = 180.0
"""What a whole collection may take with two workers."""
LEAST_SPEEDUP = 1.8


def measure(source: ToolsetSource, blocks: int = 3, episodes: int = 60) -> dict[str, CollectionTime]:
    """Return s per episode with one process and with two workers, and the time of a whole collection.

    Parameters
    ----------
    source : ToolsetSource
        Domain, actions and robot.
    blocks : int
        How many pairs of blocks; the two kinds alternate on the same episodes, so that a busy machine
        disturbs both alike, and the medians count.
    episodes : int
        Of each action in a block.

    Raises
    ------
    RuntimeError
        The machine has one core.
    """
    if (os.cpu_count() or 1) < WORKERS:
        raise RuntimeError(f"expected a machine with {WORKERS} cores, got {os.cpu_count()}")
    start = _seconds(source, 1, 1, WORKERS, SEED)  # starts the workers, which later blocks find running
    pairs = [
        [_seconds(source, episodes, ACTIONS * episodes, workers, SEED + block) for workers in (1, WORKERS)]
        for block in range(blocks)
    ]
    one, two = (statistics.median(times) for times in zip(*pairs, strict=True))
    row = CollectionTime(
        episodes=blocks * ACTIONS * episodes,
        one_process_s=round(one, 4),
        two_workers_s=round(two, 4),
        times_one_process=round(one / two, 2),
        limit_times_one_process=LEAST_SPEEDUP,
        start_s=round(start, 2),
        collection_s=round(start + two * WHOLE * ACTIONS, 1),
        limit_collection_s=LIMIT_S,
    )
    return {f"{ACTIONS} x {WHOLE} episodes": row}


def _seconds(source: ToolsetSource, episodes: int, divisor: int, workers: int, seed: int) -> float:
    """Return the wall time in s that `episodes` of each action take, divided by `divisor`."""
    domain = find_domain(source.domain)
    actions = list(domain.actions(source.action_set).values())[:ACTIONS]
    began = time.perf_counter()
    robot = source.described()
    tops = domain.tops_for(robot)
    run = collect(actions, tops, robot, objects=domain.objects, episodes=episodes, seed=seed, jobs=workers)
    for _ in run:
        pass
    return (time.perf_counter() - began) / divisor
