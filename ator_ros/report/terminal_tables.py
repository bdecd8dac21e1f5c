"""Results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ator_ros.evaluation.running import has_predictions

_BEYOND = (
    "* more than 100 %: the oracle executes headings of one subgoal at given speeds; the policy also chooses "
    "arrival speeds or other subgoals"
)


def evaluation_table(summary: Mapping[str, Any]) -> str:
    """Return the summary of an evaluation as a table for a terminal."""
    head = f"{'policy':24}{'mean s':>9}{'gain %':>8}{'95 %':>20}{'higher':>8}{'equal':>7}{'lower':>7}"
    lines = [head + f"{'oracle %':>10}{'failed':>8}"]
    beyond = False
    for name, row in summary.items():
        if isinstance(row, Mapping):
            low, high = row["improvement_ci95"]
            share = row["oracle_captured_percent"]
            captured = "-" if share is None else f"{share:.1f}{'*' * (share > 100.0)}"
            beyond |= captured.endswith("*")
            lines.append(
                f"{name:24}{row['mean_duration_s']:9.2f}{row['improvement_percent']:8.2f}"
                f"{f'{low:.2f} to {high:.2f}':>20}{row['higher']:8}{row['equal']:7}{row['lower']:7}"
                f"{captured:>10}{row['failures']:8}"
            )
    return "\n".join([*lines, *([_BEYOND] if beyond else [])])


def prediction_table(summary: Mapping[str, Any]) -> str:
    """Return the errors of predictions as a table for a terminal; empty without predictions."""
    rows = [(name, row["prediction"]) for name, row in summary.items() if has_predictions(row)]
    if not rows:
        return ""
    lines = [f"{'predicted - actual':24}{'mean s':>9}{'95 %':>18}{'MAE s':>8}{'chains':>8}"]
    for name, row in rows:
        low, high = row["mean_error_ci95"]
        lines.append(
            f"{name:24}{row['mean_error_s']:+9.3f}{f'{low:+.3f} to {high:+.3f}':>18}"
            f"{row['mae_s']:8.3f}{row['chains']:8}"
        )
    return "\n".join(lines)


def curve_table(told: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """Return the points of a learning curve as a table for a terminal."""
    lines = []
    for kind, sizes in told.items():
        lines.append(f"{kind:20}{'% of oracle':>12}{'95 %':>16}{'slower %':>10}{'failed':>8}   draws")
        for size, point in sizes.items():
            low, high = point["ci95"]
            draws = " ".join(f"{share:.0f}" for share in point["draws"])
            lines.append(
                f"  {size:18}{point['percent']:12.1f}{f'{low:.1f} to {high:.1f}':>16}"
                f"{point['slower']:10.1f}{point['failed']:8}   {draws}"
            )
    return "\n".join(lines)


def stream_table(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the summaries of streams by change as a table for a terminal."""
    lines = [f"{'robot':10}{'policy':10}{'gain s':>9}{'95 %':>18}{'failed':>8}{'of offline':>12}"]
    for change, told in summaries.items():
        naive = told["naive"]
        lines.append(f"{change:10}{'naive':10}{'':>9}{'':>18}{naive['failed']:8}   {naive['mean_s']:.2f} s")
        for name in ("shipped", "learning", "offline", "oracle"):
            if name in told:
                low, high = told[name]["ci95"]
                share = told["share_of_offline"] if name == "learning" else None
                lines.append(
                    f"{'':10}{name:10}{told[name]['gain_s']:9.3f}{f'{low:.3f} to {high:.3f}':>18}"
                    f"{told[name]['failed']:8}{'' if share is None else f'{100 * share:.0f} %':>12}"
                )
    return "\n".join(lines)
