"""The tables of an evaluation, for the terminal and on one self-contained page with Table 1."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.domains import DEFAULT
from ator_ros.evaluation.statistics import EQUAL
from ator_ros.files import write_text

REPORT = "report.html"
Part = tuple[str, str] | Any
"""A part of a page: the name of an HTML element and its text, or a DataFrame."""
PAPER_TABLE_1 = (
    ("Before filtering, paper: runs", "1000", "533", "369", "98"),
    ("Before filtering, paper: improvement", "10%", "21%", "0%", "-10%"),
    ("After filtering, paper: runs", "1000", "505", "485", "10"),
    ("After filtering, paper: improvement", "12%", "23%", "0%", "-6%"),
)
"""Rows of the paper's Table 1: title, Total, Higher, Equal and Lower."""
_WITHOUT_INTERVALS = 6  # columns of `prediction_table` for results without intervals
MEANING: Mapping[str, str] = {
    "naive": "heading at which the first action alone is fastest (the paper's unrefined choice)",
    "fixed": "heading 0 at each subgoal, as in a list of waypoints without headings",
    "arrive": "bearing of each subgoal from the place before",
    "face_goal": "bearing of the next goal, from each subgoal",
    "analytic": "search of headings with path times of the observed driving, without trees",
    "analytic_speed": "search of headings and arrival speeds with path times",
    "refined": "subgoal refinement, headings only",
    "gated": "subgoal refinement where the gate accepts the predicted gain, headings only",
    "refined_speed": "refinement of headings and arrival speeds",
    "gated_speed": "refinement of headings and arrival speeds where the gate accepts the predicted "
    "gain",
    "refined_place": "refinement of headings, arrival speeds and places",
    "stepwise": "refinement with a stop at each subgoal",
    "passing": "the same chain, all subgoals but the last one passed",
    "listed_fixed": "the order as listed, heading 0 at each station",
    "listed": "the order as listed, naive headings",
    "nearest": "the nearest station next, naive headings",
    "straight": "the order with the shortest straight lines, naive headings",
    "route": "the order with the shortest routes on the map, naive headings",
    "predicted": "the order that is predicted to be fastest, naive headings",
    "listed_refined": "the order as listed, refined headings",
    "nearest_refined": "the nearest station next, refined headings",
    "straight_refined": "the order with the shortest straight lines, refined headings",
    "route_refined": "the order with the shortest routes on the map, refined headings",
    "predicted_refined": "the order that is predicted to be fastest, then refined headings",
    "oracle": "the best of the executed headings",
    "oracle_speed": "the best of the executed headings and arrival speeds",
}
"""What each policy chooses."""
_STYLE = """
body{font:15px/1.5 sans-serif;color:#20242b;max-width:1100px;margin:0 auto;padding:20px}
table{border-collapse:collapse;font-size:13.5px;font-variant-numeric:tabular-nums}
th,td{padding:4px 8px;text-align:right;border-bottom:1px solid #dde0e4}
th:first-child,td:first-child{text-align:left}
pre{background:#f2f3f5;padding:10px;overflow-x:auto;font-size:12.5px}
"""
_NOTE = (
    f"Higher and Lower: shorter or longer than naive by more than {100 * EQUAL:.0f} %. "
    "Intervals: 95 %, bootstrap over situations. A failed chain counts at the time limit. "
    "Of oracle: share of the time that the oracle saves against naive; more than 100 % if a policy "
    "chooses other variables, too."
)


def write_report(folder: Path, result: Mapping[str, Any]) -> Path:
    """Write `report.html` to a folder and return its path.

    `result` are the contents of `evaluation.json`. Raises OSError if the file cannot be written.
    """
    summary = result["summary"]
    settings = result["settings"]
    domain = settings["source"]["domain"]
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    meanings = [(name, MEANING[name]) for name in _rows(summary)]
    origin = (
        f"Seed {summary['seed']}, {result['executed']} chains executed, digest of robot and models "
        f"{result['digest']}. {versions}, on {result['machine']}."
    )
    parts: list[Part] = [
        ("h2", "Table 1 of the paper"),
        table_1(summary, PAPER_TABLE_1 if domain == DEFAULT else ()),
        ("h2", "All policies on the same starts"),
        policy_table(summary),
        ("p", _NOTE),
        pd.DataFrame(meanings, columns=["policy", "chooses"]),
        ("h2", "Predictions"),
        prediction_table(summary),
        ("p", "Durations of whole chains that succeeded, predicted minus actual."),
        ("h2", "To repeat this"),
        ("pre", summary["command"]),
        ("p", origin),
    ]
    title = f"Subgoal refinement: chain {settings['chain']} of {domain}"
    write_text(folder / REPORT, page(title, parts))
    return folder / REPORT


def page(title: str, parts: Iterable[Part]) -> str:
    """Return an HTML page of texts and tables."""
    body = "\n".join(_html(part) for part in [("h1", title), *parts])
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title>"
        f"<style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def _html(part: Part) -> str:
    if isinstance(part, pd.DataFrame):
        return str(part.to_html(index=False, border=0))
    return f"<{part[0]}>{escape(part[1])}</{part[0]}>"


def table_1(summary: Mapping[str, Any], published: Sequence[tuple[str, ...]]) -> pd.DataFrame:
    """Return the paper's Table 1: rows of the paper, then ours.

    `summary` is that of an evaluation, `published` are rows such as `PAPER_TABLE_1`.
    """
    rows: list[tuple[str, ...]] = []
    for name, title in (("refined", "Before filtering"), ("gated", "After filtering")):
        rows += [row for row in published if row[0].startswith(title)]
        for policy in (name, f"{name}_speed"):
            if policy not in summary:
                continue
            row = summary[policy]
            counts = (str(row[kind]) for kind in ("higher", "equal", "lower"))
            changes = (
                f"{row['improvement_percent']:.1f}%",
                f"{row['mean_gain_higher_percent']:.1f}%",
                "0%",
                f"-{row['mean_loss_lower_percent']:.1f}%",
            )
            rows.append((f"{title}, {policy}: runs", str(summary["situations"]), *counts))
            rows.append((f"{title}, {policy}: improvement", *changes))
    return pd.DataFrame(rows, columns=["", "Total", "Higher", "Equal", "Lower"])


def policy_table(summary: Mapping[str, Any]) -> pd.DataFrame:
    """Return a row for each policy in the summary of an evaluation: durations, gains, failures."""
    return pd.DataFrame(
        {
            "policy": name,
            "mean s": f"{row['mean_duration_s']:.2f}",
            "gain %": f"{row['improvement_percent']:.2f}",
            "95 %": _interval(row["improvement_ci95"]),
            "higher": row["higher"],
            "equal": row["equal"],
            "lower": row["lower"],
            "worst loss %": f"{row['worst_loss_percent']:.0f}",
            "failed": row["failures"],
            "of oracle %": _share(row["oracle_captured_percent"]),
        }
        for name, row in _rows(summary).items()
    )


def _share(percent: float | None) -> str:
    return "-" if percent is None else f"{percent:.1f}"


def prediction_table(summary: Mapping[str, Any]) -> pd.DataFrame:
    """Return how well predictions hold, a row for each policy with models.

    Their errors, how many durations are within the predicted 90 % interval, and mean gains over the
    naive chains.
    """
    found = {name: row.get("prediction", {}) for name, row in _rows(summary).items()}
    calibrated = any("within_90_percent" in row for row in found.values())
    table = pd.DataFrame(
        {
            "policy": name,
            "chains": row["chains"],
            "mean error s": f"{row['mean_error_s']:+.3f}",
            "95 %": _interval(row["mean_error_ci95"], 3),
            "MAE s": f"{row['mae_s']:.3f}",
            "RMSE s": f"{row['rmse_s']:.3f}",
            "in 90 %": f"{row['within_90_percent']:.0f} %" if "within_90_percent" in row else "-",
            "predicted gain s": _seconds(row.get("gain_predicted_s")),
            "executed gain s": _seconds(row.get("gain_executed_s")),
        }
        for name, row in found.items()
        if row.get("chains")
    )
    return table if calibrated else table.iloc[:, :_WITHOUT_INTERVALS]


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _rows(summary: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    return {name: row for name, row in summary.items() if isinstance(row, Mapping)}


def _interval(bounds: Sequence[float], digits: int = 2) -> str:
    return f"{bounds[0]:.{digits}f} to {bounds[1]:.{digits}f}"
