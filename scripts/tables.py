"""Write the tables of README.md and docs/ that show results, from the reports in docs/.

    scripts/run python scripts/tables.py

A table is between the comments `begin NAME` and `end`. Those of models from few drives are written
only if the argument is a working folder of `make reproduce`, as their reports do not ship.
"""

from __future__ import annotations

import json
import re
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("README.md", "docs/results.md", "docs/results_conditions.md", "docs/table1.md")
_WORDS = {
    "fixed": "heading 0",
    "arrive": "the bearing of the arrival",
    "face_goal": "the bearing of the next goal",
}
_OPENED = {"_speed": ", with arrival speeds", "_place": ", with arrival speeds and places"}
GAINS = (
    ("fetch a ball and dribble it; heading open", "evaluation", "refined"),
    ("the same; heading and arrival speed open", "evaluation", "refined_speed"),
    ("the same with a shot, as in the picture above", "evaluation_shoot", "refined_speed"),
    ("tour of stations, driven by an independent action server", "evaluation_tour", "refined"),
    (
        "the first task with actions as in the paper, along Bezier curves",
        "evaluation_bezier",
        "refined",
    ),
)
"""Rows of README.md: the task, and a policy of a report."""
PUBLISHED = {
    "refined": "533, 369, 98 | 10 %",
    "gated": "505, 485, 10 | 12 %",
    "face_goal": "|",
    "oracle": "|",
}
"""Rows of docs/table1.md: faster, equal and slower chains, and the gain in the paper."""
ROBOTS = {
    "fifth": "[fifth](../test/fifth.yaml)",
    "pioneer_lx": "[Pioneer LX](../config/pioneer_lx.yaml)",
    "turtlebot4": "[TurtleBot 4](../config/turtlebot4.yaml)",
}
"""Robots of the studies."""
FEW_DRIVES = ("tour", "pursuit", "building")
"""Domains whose models are learned from few drives."""
Json = Mapping[str, Any]


def table(head: Sequence[str], rows: Iterable[str]) -> str:
    """Return a table in Markdown; `rows` are its lines without the outer bars."""
    lines = [" | ".join(head), " | ".join(["---"] * len(head)), *rows]
    return "\n".join(f"| {line} |".replace("  ", " ") for line in lines)


def gain(row: Json) -> str:
    """Return the gain of a policy with its interval."""
    low, high = row["improvement_ci95"]
    return f"{row['improvement_percent']:.1f} % ({low:.1f} to {high:.1f})"


def share(summary: Json, policy: str) -> str:
    """Return the captured share of the gain of the oracle with the same variables, if any."""
    captured = summary[policy]["oracle_captured_percent"]
    moving = policy.endswith("_speed") and "oracle_speed" not in summary
    is_known = captured is not None and captured > 0.0 and not moving
    return f"{captured:.0f} %" if is_known and not policy.startswith("oracle") else ""


def label(policy: str) -> str:
    """Return a policy, or an oracle, as the tables name it."""
    for suffix, text in _OPENED.items():
        policy = policy.replace(suffix, text)
    return _WORDS.get(policy, policy)


def _policies(summary: Json) -> list[str]:
    """Return the policies of a report, those that choose headings only before the others."""
    names = [name for name, row in summary.items() if isinstance(row, Mapping)]
    others = ("_speed", "_place")
    return sorted(names, key=lambda name: (name.endswith(others), name.startswith("oracle")))


def evaluation(docs: Path, name: str) -> str:
    """Return a sentence about a report, and the table of its policies."""
    summary = _summary(docs / name)
    failures = {policy: summary[policy]["failures"] for policy in _policies(summary)}
    failed = ", ".join(f"{label(policy)} {count}" for policy, count in failures.items() if count)
    intro = (
        f"{summary['situations']} situations, failures: {failed or 'none'} "
        f"([report with the command]({name}/report.html))."
    )
    text = textwrap.fill(intro, 100, break_long_words=False, break_on_hyphens=False)
    rows = []
    for policy in _policies(summary):
        row = summary[policy]
        mean = f"{label(policy)} | {row['mean_duration_s']:.2f} s"
        measured = f"{gain(row)} | {share(summary, policy)} | {row['lower']}"
        rows.append(f"{mean} | | | " if policy == "naive" else f"{mean} | {measured}")
    head = ["policy", "mean duration", "gain over naive (95 % interval)", "of the oracle's gain"]
    return f"{text}\n\n{table([*head, 'slower'], rows)}"


def _summary(folder: Path) -> Any:
    return json.loads((folder / "evaluation.json").read_text(encoding="utf-8"))["summary"]


def gains(docs: Path) -> str:
    """Return the table of README.md."""
    rows = []
    for task, name, policy in GAINS:
        summary = _summary(docs / name)
        row = summary[policy]
        means = f"{summary['naive']['mean_duration_s']:.2f} s | {row['mean_duration_s']:.2f} s"
        rows.append(f"{task} | {means} | {gain(row)} | {share(summary, policy)}")
    head = ["task", "naive", "refined", "gain (95 % interval)", "of the oracle's gain"]
    return table(head, rows)


def predictions(docs: Path) -> str:
    """Return how right the predictions of the refined chains of README.md's tasks are."""
    return _predictions((task, _summary(docs / name), policy) for task, name, policy in GAINS)


def few_predictions(work: Path) -> str:
    """Return how right predictions by models from few drives are, for tours behind the gate."""
    rows = []
    for domain in FEW_DRIVES:
        folders = (work / "few_drives").glob(f"{domain}_*/evaluation")
        drives = {int(folder.parent.name.rpartition("_")[2]): folder for folder in folders}
        rows += [
            (f"{domain}, {count} drives", _summary(folder), "gated")
            for count, folder in sorted(drives.items())
        ]
    return _predictions(rows)


def _predictions(reports: Iterable[tuple[str, Json, str]]) -> str:
    rows = []
    for task, summary, policy in reports:
        row = summary[policy]
        found = row["prediction"]
        error = 100.0 * found["mean_error_s"] / row["mean_duration_s"]
        gained = f"{found['gain_predicted_s']:.2f} s | {found['gain_executed_s']:.2f} s"
        rows.append(
            f"{task} | {error:+.1f} % | {found['mae_s']:.2f} s | "
            f"{found['within_90_percent']:.0f} % | {gained}"
        )
    head = ["task", "mean error", "mean absolute error", "within 90 %"]
    return table([*head, "gain, predicted", "gain, executed"], rows)


def table1(docs: Path) -> str:
    """Return Table 1 of the paper with the paper's actions, in short."""
    summary = _summary(docs / "evaluation_bezier")
    rows = []
    for policy, published in PUBLISHED.items():
        row = summary[policy]
        counts = " | ".join(str(row[kind]) for kind in ("higher", "equal", "lower", "failures"))
        rows.append(f"{label(policy)} | {counts} | {published}")
    head = ["chains", "faster", "equal", "slower", "failures"]
    return table([*head, "paper, of 1000: faster, equal, slower", "gain in the paper"], rows)


def studies(docs: Path) -> str:
    """Return a row for each robot that was studied."""
    rows = []
    for robot, link in ROBOTS.items():
        found = json.loads((docs / "studies" / f"{robot}.json").read_text(encoding="utf-8"))
        of = found["evaluation"]
        heading = f"{gain(of['refined'])} | {share(of, 'refined')} | {of['refined']['lower']}"
        analytic = f"{share(of, 'analytic')} | {of['analytic_speed']['improvement_percent']:.1f} %"
        naive = f"{of['naive']['mean_duration_s']:.2f} s"
        rows.append(
            f"{link} | {of['situations']} | {naive} | {heading} | {gain(of['refined_speed'])} | "
            f"{analytic}"
        )
    return table(
        [
            "robot",
            "chains",
            "naive",
            "refined, heading: gain (95 %)",
            "of the oracle's",
            "slower",
            "with speed: gain (95 %)",
            "analytic, heading: of the oracle's",
            "analytic, with speed: gain",
        ],
        rows,
    )


def few_drives(work: Path) -> str:
    """Return the tables of `few_drives.py` for all its domains, as one."""
    lines: list[str] = []
    for domain in FEW_DRIVES:
        text = (work / f"few_{domain}.md").read_text(encoding="utf-8")
        lines += text.strip().splitlines()[2 if lines else 0 :]
    return "\n".join(lines)


def few_episodes(work: Path) -> str:
    """Return what soccer gains behind the gate with models of few episodes."""
    rows = []
    folders = sorted(work.glob("few_soccer_*"), key=lambda folder: int(folder.name[11:]))
    for folder in folders:
        summary = _summary(folder)
        heading, moving = summary["gated"], summary["gated_speed"]
        rows.append(
            f"{folder.name[11:]} | {share(summary, 'gated')} | {heading['lower']} | "
            f"{gain(moving)} | "
            f"{moving['lower']}"
        )
    head = ["episodes", "heading: of the oracle's gain", "slower", "heading and speed: gain"]
    return table([*head, "slower"], rows)


def write_tables(root: Path, docs: Path, work: Path | None = None) -> None:
    """Replace the tables of the pages below `root`.

    `docs` has the reports; `work` is a working folder of `make reproduce`, or None.
    """
    made: dict[str, str] = {}
    for report in sorted(docs.glob("evaluation*")):
        made[report.name] = evaluation(docs, report.name)
    made |= {"gains": gains(docs), "predictions": predictions(docs)}
    made |= {"table1": table1(docs), "studies": studies(docs)}
    if work is not None and (work / "few_building.md").exists():
        made["few_drives"] = few_drives(work)
        made["few_predictions"] = few_predictions(work)
    few = [] if work is None else list(work.glob("few_soccer_*"))
    if work is not None and few and all((each / "evaluation.json").exists() for each in few):
        made["few_episodes"] = few_episodes(work)
    for name in PAGES:
        page = root / name
        text = page.read_text(encoding="utf-8")

        def block(found: re.Match[str]) -> str:
            content = made.get(found[1])
            shown = found[2] if content is None else f"\n{content}\n"
            return f"<!-- begin {found[1]} -->{shown}<!-- end -->"

        pattern = r"<!-- begin (\w+) -->(.*?)<!-- end -->"
        page.write_text(re.sub(pattern, block, text, flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    write_tables(ROOT, ROOT / "docs", *map(Path, sys.argv[1:2]))
