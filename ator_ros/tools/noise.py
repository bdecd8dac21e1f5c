"""Measure how often chains succeed with the sensors of a real robot, or late states, against the truth."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.noise import CONDITIONS, POINTS, TRUTH, NoiseTask, execute, summarise
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.experience.parallel import run_tasks
from ator_ros.files import portable_command, write_text
from ator_ros.robot.description import load_robot
from ator_ros.simulation.sensors import REALISTIC, REALISTIC_SIGHT
from ator_ros.tools.command_line import add_jobs, destination, guarded, whole


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `noise`."""
    parser = argparse.ArgumentParser(prog="noise", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1), default=200, help="for each chain (default: %(default)s)"
    )
    parser.add_argument("--seed", type=whole(), default=911)
    parser.add_argument("--chains", nargs="+", choices=list(SOCCER.chains), default=list(SOCCER.chains))
    parser.add_argument("--policy", choices=list(POLICIES), default="refined")
    parser.add_argument(
        "--conditions", nargs="+", choices=list(CONDITIONS), default=list(CONDITIONS), metavar="NAME",
        help=f"of {', '.join(map(repr, CONDITIONS))}; the truth is always among them",
    )  # fmt: skip
    parser.add_argument("--action-set", choices=list(SOCCER.action_sets), default="default")
    parser.add_argument("--models", default="", help="folder of the models (default: the shipped ones)")
    add_jobs(parser)
    parser.add_argument("--out", type=destination, default=Path("docs/robustness_noise.json"))
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; give the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = arguments().parse_args(words)
    return guarded("noise", lambda: _noise(options, portable_command("noise", words)))


def _noise(options: argparse.Namespace, command: str) -> int:
    result = {
        "command": command,
        "seed": options.seed,
        "situations": options.situations,
        "policy": options.policy,
        "action_set": options.action_set,
        "robot_digest": load_robot().digest(),
        "sensors": dataclasses.asdict(REALISTIC)
        | {"objects": dict.fromkeys(SOCCER.objects, dataclasses.asdict(REALISTIC_SIGHT))},
        "limit_points": POINTS,
        "chains": {chain: _measure(chain, options) for chain in options.chains},
    }
    write_text(options.out, json.dumps(result, indent=1) + "\n")
    print(_table(result["chains"]))
    print(f"written to {options.out}")
    return 0


def _measure(chain: str, options: argparse.Namespace) -> list[dict[str, Any]]:
    source = ToolsetSource(action_set=options.action_set, models=options.models)
    conditions = (TRUTH, *(name for name in options.conditions if name != TRUTH))
    work = [
        NoiseTask(options.seed, index, chain, options.policy, conditions, source)
        for index in range(options.situations)
    ]
    runs = run_tasks(execute, work, jobs=options.jobs)
    return summarise(list(tqdm(runs, total=len(work), desc=chain, disable=None)))


def _table(chains: dict[str, list[dict[str, Any]]]) -> str:
    lines = [f"{'chain':10}{'condition':36}{'success %':>10}{'below truth':>13}{'95 %':>18}{'mean s':>9}"]
    for chain, rows in chains.items():
        for row in rows:
            low, high = row["points_below_truth_ci95"]
            duration = row["mean_duration_s"]
            lines.append(
                f"{chain:10}{row['condition']:36}{row['success_percent']:10.1f}"
                f"{row['points_below_truth']:13.1f}{f'{low:.1f} to {high:.1f}':>18}"
                f"{'-' if duration is None else f'{duration:.2f}':>9}"
            )
            lines += [f"{'':14}{count} x {reason}" for reason, count in row["failures"].items()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
