"""The tables of the report: Table 1 of the paper beside ours, and all policies side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ator_ros.domains.domain import find_domain
from ator_ros.domains.presentation import Presentation
from ator_ros.drawing import svg_text
from ator_ros.evaluation.situation import Settings
from ator_ros.evaluation.statistics import EQUAL
from ator_ros.report import charts
from ator_ros.report.page import cards, figure, paragraph, section, table

#: What each policy chooses; {place} is what the first subgoal of a chain is.
MEANING: Mapping[str, str] = {
    "naive": "heading at which the first action alone is fastest (the paper's unrefined choice)",
    "bearing": "plain bearing from robot to {place}",
    "face_goal": "bearing of the next goal, from each subgoal",
    "refined": "subgoal refinement, heading only",
    "gated": "the same, where the gate expects it to pay",
    "refined_speed": "refinement of heading and arrival speed",
    "gated_speed": "the same, behind the gate",
    "bitbots": "our search with bit-bots' hand-set time model",
    "bitbots_refitted": "that model, refitted to our robot",
    "booster": "our search with the cost of Booster's demo",
    "booster_refitted": "that cost, refitted to our robot",
    "turn_drive_turn": "our search with the time to turn, drive and turn, nothing learned",
    "ideal_time": "our search with our features' ideal times, nothing learned",
    "ideal_time_speed": "the same for heading and arrival speed",
    "hist_gradient_boosting": "our search with gradient boosting, the ceiling of prediction",
    "oracle": "the best of the executed headings",
    "oracle_speed": "the best of the executed headings and arrival speeds",
}

COUNTS = ("higher", "equal", "lower")
_POLICY_HEAD = (
    *("policy", "mean s", "of sums %", "95 %", "mean of ratios %", "95 %", *COUNTS, "worst loss %", "failed"),
    *("of oracle %", "95 %", "behind refined s, 95 %", "behind gated s, 95 %"),
)


def verdict(summary: Mapping[str, Any], place: str) -> str:
    """Return in words what came out."""
    best = summary.get("gated", summary.get("refined", summary["naive"]))
    low, high = best["improvement_ci95"]
    text = (
        f"Over {summary['situations']} random situations, each chain executed in the simulator, "
        f"refining the heading at the {place} saves {best['improvement_percent']:.1f} % of the time "
        f"({low:.1f} to {high:.1f} %) "
        f"and makes {best['lower']} runs slower by more than {100 * EQUAL:.0f} %."
    )
    if best["oracle_captured_percent"] is not None:
        text += (
            f" That is {best['oracle_captured_percent']:.0f} % of what the best executed heading could save."
        )
    if "gated_speed" in summary:
        speed = summary["gated_speed"]["improvement_percent"]
        text += f" With the arrival speed free too it saves {speed:.1f} %."
    return text


def headline(summary: Mapping[str, Any]) -> str:
    """Return the most important numbers, big."""
    items = [(f"{summary['naive']['mean_duration_s']:.2f} s", "mean duration, naive")]
    for name in ("gated", "gated_speed", "oracle", "oracle_speed"):
        if name in summary:
            row = summary[name]
            items.append(
                (f"{row['mean_duration_s']:.2f} s", f"{name}: {row['improvement_percent']:.1f} % less")
            )
    return cards(items)


def table1(summary: Mapping[str, Any], published: Sequence[tuple[str, ...]]) -> str:
    """Return Table 1, the published rows and ours."""
    rows: list[tuple[str, ...]] = []
    ours = []
    for name, title in (("refined", "Before filtering"), ("gated", "After filtering")):
        rows += [row for row in published if row[0].startswith(title)]
        for policy in (name, f"{name}_speed"):
            if policy not in summary:
                continue
            row = summary[policy]
            ours += [len(rows), len(rows) + 1]
            rows.append(
                (f"{title}, {policy}: runs", str(summary["situations"]), *(str(row[k]) for k in COUNTS))
            )
            rows.append(
                (
                    f"{title}, {policy}: improvement",
                    f"{row['improvement_percent']:.1f}%",
                    f"{row['mean_gain_higher_percent']:.1f}%",
                    "0%",
                    f"-{row['mean_loss_lower_percent']:.1f}%",
                )
            )
    return section(
        "Table 1 of the paper",
        table(("", "Total", "Higher", "Equal", "Lower"), rows, ours=ours),
        paragraph(
            f"Higher and Lower: shorter or longer than naive by more than {100 * EQUAL:.0f} %. Total is of "
            "the summed durations, Higher and Lower are means of the runs' own percentages.",
            "note",
        ),
    )


def _behind(name: str, row: Mapping[str, Any], ours: str) -> str:
    """Return the interval behind one of our policies: that with the same free variables."""
    key = f"behind_{ours}{'_speed' * name.endswith('_speed')}_ci95"
    return _interval(row[key]) if key in row else "-"


def policies(summary: Mapping[str, Any], settings: Settings, presentation: Presentation) -> str:
    """Return all policies, as bars and as a table."""
    found = {name: row for name, row in summary.items() if isinstance(row, Mapping)}
    ours = [index for index, name in enumerate(found) if name.startswith(("gated", "refined"))]
    words = {**MEANING, **presentation.policies}
    meanings = [(name, words[name].format(place=presentation.place)) for name in found if name in words]
    limit, oracle = find_domain(settings.source.domain).time_limit, _oracle_note(settings)
    return section(
        "All policies on the same starts",
        figure(
            svg_text(charts.gain_bars(summary)), "Time saved against naive, of the sums, with 95 % intervals."
        ),
        table(_POLICY_HEAD, [_policy_row(name, row) for name, row in found.items()], ours=ours),
        paragraph(
            f"Intervals: bootstrap over situations. A failed chain counts {limit:g} s.{oracle} "
            "Of oracle: share of the time that the oracle saves against naive.",
            "note",
        ),
        table(("policy", "what it chooses"), meanings),
    )


def _policy_row(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    share = row["oracle_captured_percent"]
    return (
        name,
        f"{row['mean_duration_s']:.2f}",
        f"{row['improvement_percent']:.2f}",
        _interval(row["improvement_ci95"]),
        f"{row['mean_ratio_improvement_percent']:.2f}",
        _interval(row["mean_ratio_improvement_ci95"]),
        *(str(row[k]) for k in COUNTS),
        f"{row['worst_loss_percent']:.0f}",
        str(row["failures"]),
        "-" if share is None else f"{share:.1f}",
        "-" if share is None else _interval(row["oracle_captured_ci95"]),
        _behind(name, row, "refined"),
        _behind(name, row, "gated"),
    )


def _oracle_note(settings: Settings) -> str:
    """Return what the oracle executed, in sentences that each begin with a space."""
    note = f" The oracle executed {settings.oracle} headings." if settings.oracle else ""
    if settings.oracle and settings.joint_oracle:
        note = (
            f" The oracle executed the legs between {settings.oracle} headings, and those that the policies "
            "chose, at every open step, and then the chain that takes least by them."
        )
    if settings.oracle_margin is not None:
        note += f" It left out headings predicted {settings.oracle_margin:g} s behind its best."
    if settings.oracle_speeds:
        speeds = ", ".join(f"{v:g}" for v in (0.0, *settings.oracle_speeds))
        note += f" Its speeds at each heading: {speeds} m/s."
    return note


def _interval(bounds: Sequence[float]) -> str:
    return f"{bounds[0]:.2f} to {bounds[1]:.2f}"
