"""Measure the actions: success, regularity, and time over the time-optimal motion."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.action_quality import KINDS, Outcome, Task, execute, regularity, summary, tasks
from ator_ros.evaluation.ruler import over_time_optimal
from ator_ros.experience.parallel import run_tasks
from ator_ros.files import portable_command, write_text
from ator_ros.report.soccer_slices import draw_slices
from ator_ros.robot.description import load_robot
from ator_ros.tools.command_line import add_jobs, destination, guarded, whole

RULED = ("pose", "approach", "dribble")


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `qualify`."""
    parser = argparse.ArgumentParser(prog="qualify", description=__doc__)
    parser.add_argument(
        "--situations", type=whole(1), default=1000, help="of each kind (default: %(default)s)"
    )
    parser.add_argument(
        "--turned", type=whole(), default=300, help="of them also turned by 1 degree either way"
    )
    parser.add_argument(
        "--pairs", type=whole(), default=200, help="of them compared with the time-optimal motion"
    )
    parser.add_argument("--seed", type=whole(), default=901)
    parser.add_argument("--action-set", choices=list(SOCCER.action_sets), default="default")
    add_jobs(parser)
    parser.add_argument("--out", type=destination, default=Path("docs/actions.json"))
    parser.add_argument(
        "--optimal", type=Path, metavar="DIR",
        help="folder of the ruler: optimal_KIND.json (the times in s that benchmarks/time_optimal.py prints "
        "for pairs_KIND.json) is read there; without it pairs_KIND.json is written",
    )  # fmt: skip
    parser.add_argument(
        "--slices", type=destination, metavar="PNG", help="also draw duration against start heading"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; give the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = arguments().parse_args(words)
    return guarded("qualify", lambda: _qualify(options, portable_command("qualify", words)))


def _qualify(options: argparse.Namespace, command: str) -> int:
    rows = [_measure(kind, options) for kind in KINDS]
    result = {
        "command": command,
        "seed": options.seed,
        "action_set": options.action_set,
        "robot_digest": load_robot().digest(),
        "kinds": rows,
    }
    write_text(options.out, json.dumps(result, indent=1) + "\n")
    write_text(options.out.with_suffix(".md"), _document(result))
    print(json.dumps(rows, indent=1))
    if options.slices is not None:
        draw_slices(options.slices, options.action_set, options.jobs)
    print(f"written to {options.out}")
    return 0


def _measure(kind: str, options: argparse.Namespace) -> dict[str, Any]:
    base = _run(kind, tasks(kind, options.action_set, options.seed, options.situations), options.jobs)
    row = summary(kind, base)
    few = base[: options.turned]
    turned = [
        _run(f"{kind} turned", tasks(kind, options.action_set, options.seed, len(few), degrees), options.jobs)
        for degrees in (-1, 1)
    ]
    if few:
        row["turned_by_1_degree"] = regularity([*few, *few], [*turned[0], *turned[1]])
    if options.optimal is not None and kind in RULED:
        row |= over_time_optimal(kind, base[: options.pairs], options.optimal)
    return row


def _run(label: str, work: list[Task], jobs: int) -> list[Outcome]:
    return list(tqdm(run_tasks(execute, work, jobs=jobs), total=len(work), desc=label, disable=None))


def _document(result: dict[str, Any]) -> str:
    """Write the result as a Markdown table."""
    lines = [
        f"# How the actions perform (set `{result['action_set']}`)",
        "",
        f"Made by `{result['command']}`, seed {result['seed']}. Starts and goals at rest, times in s.",
        "*Turned by 1°* is the change of duration when only the start's heading changes by a degree;",
        "control ticks of 0.05 s are in it. *Over plan* is the mean and standard deviation of the duration",
        "less that planned at the start. *Over time-optimal* is the mean duration over that of the",
        "time-optimal motion (`benchmarks/time_optimal.py`) at the same limits, which knows no ball",
        "and may drive backward; for dribbling at 1.0 m/s, 1.2 rad/s, 0.5 m/s² (losing speed), 3 rad/s².",
        "*Greatest command / limit* compares speeds and turn rates with what the base can do; how fast they",
        "change is not in it; the base clips that.",
        "",
        "| | situations | success | ball moved early | mean duration | greatest command / limit "
        "| turned by 1°: p95 / p99 | over plan | over time-optimal |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in result["kinds"]:
        turned = row.get("turned_by_1_degree")
        change = f"{turned['p95_s']:.2f} / {turned['p99_s']:.2f}" if turned else "-"
        mean = "-" if row["mean_duration_s"] is None else f"{row['mean_duration_s']:.2f}"
        plan = (
            f"{row['over_plan_mean_s']:.3f} ± {row['over_plan_std_s']:.3f}"
            if "over_plan_mean_s" in row
            else "-"
        )
        over = f"{row['over_time_optimal']:.3f} ({row['pairs']} pairs)" if "over_time_optimal" in row else "-"
        lines.append(
            f"| {row['kind']} | {row['situations']} | {row['success_percent']} % "
            f"| {row['ball_moved_early_percent']} % | {mean} "
            f"| {row['greatest_command_over_limit']:.2f} | {change} | {plan} | {over} |"
        )
    failures = [f"* {row['kind']}: {reason}" for row in result["kinds"] for reason in row["failures"]]
    lines += ["", "What failed:" if failures else "Nothing failed.", "", *failures]
    return "\n".join(lines).strip() + "\n"


if __name__ == "__main__":
    sys.exit(main())
