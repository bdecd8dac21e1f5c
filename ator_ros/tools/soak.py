"""Run chains back to back over ROS for a set time, and compare the nodes at the end with the beginning."""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from ator_ros.experience.table import library_versions
from ator_ros.experiments.trials import random_trial
from ator_ros.files import write_text
from ator_ros.robot import load_robot
from ator_ros.tools.command_line import whole
from ator_ros.tools.processes import NodeEndedError, NodeProcesses
from ator_ros.tops.library import TopLibrary

T = TypeVar("T")
NODES = ("simulation", "refinement", "executor")
WARM_UP_S = 10.0
"""Time in s before the first sample counts: caches fill, imports happen."""
_SHARE = 0.2
_MEMORY_SHARE, _MEMORY_MIB = 0.05, 4.0
_ODOM_TIMEOUT = 2.0


@dataclass(frozen=True, slots=True)
class Sample:
    """A node at one moment: resident memory in MiB, threads, open files."""

    memory: float
    threads: int
    files: int


@dataclass
class Soak:
    """What was seen: chains run, those that failed, samples of each node, and answer times in s."""

    chains: int = 0
    failures: list[str] = field(default_factory=list)
    samples: dict[str, list[Sample]] = field(default_factory=lambda: {name: [] for name in NODES})
    answers: list[float] = field(default_factory=list)


def sample(pid: int) -> Sample:
    """Measure a process; Linux only."""
    process = Path(f"/proc/{pid}")
    pages = int((process / "statm").read_text(encoding="ascii").split()[1])
    return Sample(
        pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
        len(list((process / "task").iterdir())),
        len(list((process / "fd").iterdir())),
    )


def summary(soak: Soak) -> dict[str, Any]:
    """Give the first fifth of what was seen beside the last one, and `worse`: what has grown, in words."""
    worse: list[str] = []
    nodes: dict[str, Any] = {}
    for name, samples in soak.samples.items():
        first, last = _ends(samples)
        row: dict[str, list[float]] = {}
        for measure in ("memory", "threads", "files"):
            before, after = (statistics.median(getattr(s, measure) for s in end) for end in (first, last))
            row[measure] = [round(before, 2), round(after, 2)]
            room = max(_MEMORY_MIB, _MEMORY_SHARE * before) if measure == "memory" else 0.0
            if after > before + room:
                worse.append(f"{measure} of {name} grew from {before:.2f} to {after:.2f}")
        nodes[name] = row
    first_answers, last_answers = _ends(soak.answers)
    return {
        "chains": soak.chains,
        "failures": soak.failures,
        "nodes_first_and_last_fifth": nodes,
        "odom_to_command_ms": [_milliseconds(first_answers), _milliseconds(last_answers)],
        "worse": worse,
    }


def _ends(values: list[T]) -> tuple[list[T], list[T]]:
    count = max(1, math.ceil(_SHARE * len(values)))
    return values[:count], values[-count:]


def _milliseconds(times: list[float]) -> dict[str, float]:
    if len(times) < 2:
        return {}
    steps = statistics.quantiles(times, n=100)
    return {"median": round(1e3 * steps[49], 3), "p99": round(1e3 * steps[98], 3)}


def run(*, duration: float, real_time_factor: float, seed: int) -> Soak:
    """Start the three nodes and execute random chains for `duration` (s of real time)."""
    from ament_index_python.packages import get_package_prefix

    from ator_ros.nodes.conversions import chain_of
    from ator_ros.tools.soak_client import SoakClient

    domain = 1 + os.getpid() % 100
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    robot = load_robot()
    library, soak = TopLibrary(robot), Soak()
    with NodeProcesses(Path(get_package_prefix("ator_ros"), "lib", "ator_ros"), domain) as nodes:
        nodes.start("simulation", {"real_time_factor": real_time_factor, "command_wait": 1.0})
        nodes.start("refinement", {})
        nodes.start("executor", {"odom_timeout": _ODOM_TIMEOUT, "refinement_timeout": 2.0})
        with SoakClient(domain, nodes.check) as client:
            client.ready()
            began = time.monotonic()
            while (elapsed := time.monotonic() - began) < duration:
                trial = random_trial(seed, soak.chains, "dribble", robot, library)
                client.place(trial.world)
                ended = client.execute(chain_of(trial.chain, action_set="", frame="odom"), refine=True)
                soak.chains += 1
                if not ended.success:
                    soak.failures.append(f"{trial.index}: {ended.reason}")
                answers = client.take_answers()
                if elapsed >= min(WARM_UP_S, duration / 2):
                    soak.answers += answers
                    for name in NODES:
                        soak.samples[name].append(sample(nodes.pid(name)))
                print(f"\r{elapsed:6.0f} of {duration:.0f} s, {soak.chains} chains", end="", flush=True)
    print()
    return soak


def arguments() -> argparse.ArgumentParser:
    """Give the command line of `soak`."""
    parser = argparse.ArgumentParser(prog="soak", description=__doc__)
    parser.add_argument("--duration", type=_positive, default=120.0, metavar="S", help="default: %(default)s")
    parser.add_argument("--real-time-factor", type=float, default=0.0, metavar="F", help="0: highest")
    parser.add_argument("--seed", type=whole(), default=701)
    parser.add_argument("--out", type=Path, default=Path("build/soak.json"), metavar="FILE.json")
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"expected a time above 0 s, got {text}")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 1 where something has grown or a node has ended."""
    options = arguments().parse_args(argv)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        soak = run(duration=options.duration, real_time_factor=options.real_time_factor, seed=options.seed)
    except ImportError as error:
        print(f"soak: {error}: source your ROS 2 workspace, or use make run", file=sys.stderr)
        return 1
    except (NodeEndedError, RuntimeError) as error:
        print(f"soak: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted")
        return 130
    if not soak.answers:
        print(
            f"soak: expected chains after the warm-up, {options.duration:g} s are too short", file=sys.stderr
        )
        return 1
    report = {"duration_s": options.duration, "real_time_factor": options.real_time_factor, **summary(soak)}
    report["versions"] = library_versions()
    text = json.dumps(report, indent=1)
    write_text(options.out, text + "\n")
    print(text)
    return 1 if report["worse"] else 0


if __name__ == "__main__":
    sys.exit(main())
