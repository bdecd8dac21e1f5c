"""What `qualify` measures in soccer: success, regularity, and time over the time-optimal motion."""

from __future__ import annotations

import dataclasses
import json

from tqdm import tqdm

from ator_ros.domains.measurements import QualityRun
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.quality.action_quality import KINDS, Outcome, execute, regularity, summary, tasks
from ator_ros.domains.soccer.quality.quality_result import FORMAT, KindResult, QualityResult
from ator_ros.domains.soccer.quality.ruler import over_time_optimal
from ator_ros.domains.soccer.quality.slices import draw_slices
from ator_ros.experience.parallel import run_tasks
from ator_ros.files import write_text
from ator_ros.schema import unstructured

RULED = ("pose", "approach", "dribble")


def run(asked: QualityRun) -> None:
    """Measure each kind of motion; write and print the result."""
    kinds = tuple(_measure(kind, asked) for kind in KINDS)
    digest = SOCCER.robot(asked.robot or None).digest()
    result = QualityResult(asked.command, asked.seed, asked.action_set, digest, kinds)
    plain = unstructured(result)
    write_text(asked.out, FORMAT.text(plain))
    write_text(asked.out.with_suffix(".md"), document(result))
    print(json.dumps(plain["kinds"], indent=1))
    if asked.slices is not None:
        draw_slices(asked.slices, asked.action_set, asked.jobs, asked.robot)
    print(f"written to {asked.out}")


def _measure(kind: str, asked: QualityRun) -> KindResult:
    def execute_all(label: str, count: int, degrees: int = 0) -> list[Outcome]:
        work = tasks(kind, asked.action_set, asked.seed, count, degrees, robot=asked.robot)
        runs = run_tasks(execute, work, jobs=asked.jobs)
        return list(tqdm(runs, total=len(work), desc=label, disable=None))

    base = execute_all(kind, asked.situations)
    row = summary(kind, base)
    few = base[: asked.turned]
    turned = [execute_all(f"{kind} turned", len(few), degrees) for degrees in (-1, 1)]
    if few:
        changes = regularity([*few, *few], [*turned[0], *turned[1]])
        row = dataclasses.replace(row, turned_by_1_degree=changes)
    if asked.optimal is not None and kind in RULED:
        over = over_time_optimal(kind, base[: asked.pairs], asked.optimal)
        row = row if over is None else dataclasses.replace(row, **vars(over))
    return row


def document(result: QualityResult) -> str:
    """Write the result as a Markdown table."""
    lines = [
        f"# How the actions perform (set `{result.action_set}`)",
        "",
        f"Made by `{result.command}`, seed {result.seed}. Starts and goals at rest, times in s.",
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
    lines += [_line(row) for row in result.kinds]
    failures = [f"* {row.kind}: {reason}" for row in result.kinds for reason in row.failures]
    lines += ["", "What failed:" if failures else "Nothing failed.", "", *failures]
    return "\n".join(lines).strip() + "\n"


def _line(row: KindResult) -> str:
    """Return one line of the table."""
    turned = row.turned_by_1_degree
    change = f"{turned.p95_s:.2f} / {turned.p99_s:.2f}" if turned else "-"
    mean = "-" if row.mean_duration_s is None else f"{row.mean_duration_s:.2f}"
    planned = row.over_plan_mean_s is not None
    plan = f"{row.over_plan_mean_s:.3f} ± {row.over_plan_std_s:.3f}" if planned else "-"
    ruled = row.over_time_optimal is not None
    over = f"{row.over_time_optimal:.3f} ({row.pairs} pairs)" if ruled else "-"
    return (
        f"| {row.kind} | {row.situations} | {row.success_percent} % "
        f"| {row.ball_moved_early_percent} % | {mean} "
        f"| {row.greatest_command_over_limit:.2f} | {change} | {plan} | {over} |"
    )
