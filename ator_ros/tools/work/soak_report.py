"""The observations of a soak, and the report about them."""

from __future__ import annotations

import itertools
import math
import os
import platform
import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from ator_ros.experience.table import library_versions
from ator_ros.tools.work.soak_result import (
    CpuShares,
    Milliseconds,
    NodeGrowth,
    SoakReport,
    TickLateness,
)

T = TypeVar("T")
NODES = ("simulation", "refinement", "executor")
SHARE = 0.2
"""Share of the observations that counts as the beginning, and as the end."""
MEMORY_SHARE, MEMORY_MIB = 0.05, 4.0
LATER, LATER_MS = 2.0, 10.0
FAILED_SHARE = 0.1
PUNCTUAL_S, PUNCTUAL_SHARE = 0.005, 0.99
EXECUTOR_CPU, IDLE_REFINEMENT_CPU = 0.15, 0.02
_REASONS = 20

MEANING = {
    "nodes": "memory: resident MiB; threads; files: open ones; [median of the first fifth, of the last one]",
    "odom_to_command_ms": "from an odometry message to the next command, as a third process hears both",
    "tick_lateness_ms": "of commands, either way, against the 20 Hz grid of their chain; at real time only",
    "cpu": "share of one core: idle (no goal), and while chains run",
    "worse": f"memory grown by more than {MEMORY_SHARE:.0%} and {MEMORY_MIB:g} MiB, more threads or files, "
    f"answers' median later than {LATER:g} times and {LATER_MS:g} ms, over {FAILED_SHARE:.0%} of chains "
    f"failed; at real time: less than {PUNCTUAL_SHARE:.0%} of the ticks within {1e3 * PUNCTUAL_S:g} ms, "
    f"more CPU than {EXECUTOR_CPU:.0%} (executor) and {IDLE_REFINEMENT_CPU:.0%} (refinement, idle)",
}
"""What the report's entries mean."""


@dataclass(frozen=True, slots=True)
class Sample:
    """A node at one moment: resident memory in MiB, threads, open files, CPU time in s that it has used."""

    memory: float
    threads: int
    files: int
    cpu: float = 0.0


@dataclass(frozen=True, slots=True)
class Answer:
    """A command that answered odometry: its stamp, and when both were heard, in s of real time."""

    stamp: float
    asked: float
    told: float


@dataclass
class Soak:
    """Observations: number of chains, failures, hiccups; samples and CPU of each node; answers."""

    chains: int = 0
    failures: list[str] = field(default_factory=list)
    hiccups: list[str] = field(default_factory=list)
    samples: dict[str, list[Sample]] = field(default_factory=lambda: {name: [] for name in NODES})
    idle_cpu: dict[str, float] = field(default_factory=dict)
    busy: float = 0.0
    busy_cpu: dict[str, float] = field(default_factory=lambda: dict.fromkeys(NODES, 0.0))
    answers: list[list[Answer]] = field(default_factory=list)


def sample(pid: int) -> Sample:
    """Measure a process; Linux only."""
    process = Path(f"/proc/{pid}")
    pages = int((process / "statm").read_text(encoding="ascii").split()[1])
    used = (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13]
    return Sample(
        pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
        len(list((process / "task").iterdir())),
        len(list((process / "fd").iterdir())),
        sum(map(int, used)) / os.sysconf("SC_CLK_TCK"),
    )


def report_of(soak: Soak, command: str, *, real_time: bool = False) -> SoakReport:
    """Compare the first fifth of the observations with the last one; find the limits that were exceeded.

    Parameters
    ----------
    soak : Soak
        What was seen.
    command : str
        The command that asked.
    real_time : bool
        Whether time went as it does on a robot: then ticks and CPU are judged, too.
    """
    nodes, worse = _nodes(soak)
    answers = [[answer.told - answer.asked for answer in chain] for chain in soak.answers]
    both = [_milliseconds(list(itertools.chain(*end))) for end in _ends(answers)]
    first, last = (part.median or 0.0 for part in both)
    if last > LATER * first + LATER_MS:
        worse.append(f"the median time to a command grew from {first:.1f} to {last:.1f} ms")
    if len(soak.failures) > FAILED_SHARE * soak.chains:
        worse.append(f"{len(soak.failures)} of {soak.chains} chains failed")
    cpu = CpuShares(
        idle={name: round(share, 4) for name, share in soak.idle_cpu.items()},
        chains={name: round(used / max(soak.busy, 1e-9), 4) for name, used in soak.busy_cpu.items()},
    )
    lateness = _judge_ticks(soak, worse) if real_time else None
    if real_time:
        _judge_cpu(cpu, worse)
    return SoakReport(
        command=command,
        machine=f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}",
        versions=library_versions(),
        meaning=MEANING,
        chains=soak.chains,
        failed=len(soak.failures),
        failures=dict(Counter(soak.failures).most_common(_REASONS)),
        hiccups=tuple(soak.hiccups),
        nodes=nodes,
        odom_to_command_ms=tuple(both),
        cpu=cpu,
        worse=tuple(worse),
        tick_lateness_ms=lateness,
    )


def _nodes(soak: Soak) -> tuple[dict[str, NodeGrowth], list[str]]:
    worse: list[str] = []
    nodes: dict[str, NodeGrowth] = {}
    for name, samples in soak.samples.items():
        row: dict[str, tuple[float, ...]] = {}
        for measure in ("memory", "threads", "files"):
            before, after = (statistics.median(getattr(s, measure) for s in end) for end in _ends(samples))
            row[measure] = (round(before, 2), round(after, 2))
            room = max(MEMORY_MIB, MEMORY_SHARE * before) if measure == "memory" else 0.0
            if after > before + room:
                worse.append(f"{measure} of {name} grew from {before:.2f} to {after:.2f}")
        nodes[name] = NodeGrowth(**row)
    return nodes, worse


def _judge_ticks(soak: Soak, worse: list[str]) -> TickLateness:
    """Return how punctual the commands were: each is due at its stamp, relative to the chain's median."""
    lateness: list[float] = []
    for chain in soak.answers:
        delays = [answer.told - answer.stamp for answer in chain]
        lateness += [abs(delay - statistics.median(delays)) for delay in delays]
    within = sum(late <= PUNCTUAL_S for late in lateness) / max(1, len(lateness))
    if within < PUNCTUAL_SHARE:
        worse.append(f"expected {PUNCTUAL_SHARE:.0%} of the ticks within 5 ms, got {within:.2%}")
    return TickLateness(len(lateness), round(within, 4), **vars(_milliseconds(lateness)))


def _judge_cpu(cpu: CpuShares, worse: list[str]) -> None:
    executor, refinement = cpu.chains["executor"], cpu.idle.get("refinement", 0.0)
    if executor >= EXECUTOR_CPU:
        worse.append(f"the executor takes {executor:.1%} of a core, expected less than {EXECUTOR_CPU:.0%}")
    if refinement >= IDLE_REFINEMENT_CPU:
        worse.append(f"refinement idle takes {refinement:.1%}, expected less than {IDLE_REFINEMENT_CPU:.0%}")


def _ends(values: Sequence[T]) -> tuple[Sequence[T], Sequence[T]]:
    count = max(1, math.ceil(SHARE * len(values)))
    return values[:count], values[-count:]


def _milliseconds(times: list[float]) -> Milliseconds:
    if len(times) < 2:
        return Milliseconds()
    steps = statistics.quantiles(times, n=100)
    return Milliseconds(*(round(1e3 * value, 3) for value in (steps[49], steps[98], max(times))))
