"""How far predictions are from what was executed, as a table of several evaluations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.running import has_predictions
from ator_ros.evaluation.statistics import OURS

HEAD = "| chain | seed | policy | chains | predicted - actual (s) | 95 % | MAE (s) |"


def prediction_report(results: Sequence[Mapping[str, Any]], command: str) -> str:
    """Return a Markdown page on the predictions of our policies in evaluations, as `read_result` reads them.

    Raises
    ------
    EvaluationError
        None of them holds predictions.
    """
    rows = [row for result in results for row in _rows(result)]
    if not rows:
        raise EvaluationError("expected evaluations with predictions of our policies: evaluate again")
    made = [f"    {result['summary']['command']}" for result in results]
    return "\n".join(
        [
            "# How far predictions are from what is executed",
            "",
            f"Made by `{command}` from what these have executed:",
            "",
            *made,
            "",
            "Mean of predicted minus actual duration over the chains that succeeded, with 95 % bootstrap",
            "intervals over situations, and the mean absolute error.",
            "",
            HEAD,
            "| --- | --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def _rows(result: Mapping[str, Any]) -> list[str]:
    chain, summary = result["settings"]["chain"], result["summary"]
    return [
        _row(f"{chain} | {summary['seed']} | {name}", summary[name]["prediction"])
        for name in ("naive", *OURS)
        if has_predictions(summary.get(name)) and "mean_error_s" in summary[name]["prediction"]
    ]


def _row(head: str, errors: Mapping[str, Any]) -> str:
    low, high = errors["mean_error_ci95"]
    middle = f"{errors['mean_error_s']:+.3f} | {low:+.3f} to {high:+.3f}"
    return f"| {head} | {errors['chains']} | {middle} | {errors['mae_s']:.3f} |"
