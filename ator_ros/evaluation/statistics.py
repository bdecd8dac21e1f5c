"""The statistics of an evaluation, as in Table 1 (paper, section 5), and errors of predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.performance.accuracy import mean_ci95, resampled_means

EQUAL = 0.02
"""Runs whose durations differ by no more than this share count as equal, as in Table 1."""
_TO_90 = 1.645  # standard deviations of half a 90 % interval of a normal distribution
_LEAST_SAVED = 0.0005  # share of the naive durations that an oracle must save for a captured share


def summarize(records: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the figures of Table 1 of each policy (paper, section 5).

    Intervals are 95 %, bootstrapped over situations. A failed chain counts with the time limit as
    duration. `records` are those of `evaluate_trial`.

    Returns
    -------
    dict
        By policy, and for the oracle: mean_duration_s, improvement_percent (of the sums, against
        naive), improvement_ci95, mean_ratio_improvement_percent (mean over the runs), higher,
        equal, lower (runs), mean_gain_higher_percent, mean_loss_lower_percent, worst_loss_percent,
        failures, oracle_captured_percent and oracle_captured_ci95 (share of the gain of the oracle
        with the same variables).
    """
    runs = {
        name: [record["policies"][name] for record in records] for name in records[0]["policies"]
    }
    oracles = [name for name in ("oracle", "oracle_speed") if name in records[0]]
    runs |= {name: [record[name] for record in records] for name in oracles}
    durations = {}
    for name, rows in runs.items():
        column = "best" if name in oracles else "duration"
        durations[name] = np.array([row[column] for row in rows], dtype=float)
    means = resampled_means(np.stack(list(durations.values())))
    resampled = dict(zip(durations, means, strict=True))
    summaries = {}
    for name, rows in runs.items():
        summaries[name] = _policy_summary(name, durations, resampled)
        summaries[name]["failures"] = sum(not row["success"] for row in rows)
    return summaries


def _policy_summary(
    name: str,
    durations: Mapping[str, FloatArray],
    resampled: Mapping[str, FloatArray],
) -> dict[str, Any]:
    duration = durations[name]
    reference = durations["naive"]
    gain = (reference - duration) / reference
    ratio = 100.0 * gain
    higher = ratio[gain > EQUAL]
    lower = ratio[gain < -EQUAL]
    summary: dict[str, Any] = {
        "mean_duration_s": _rounded(duration.mean()),
        "improvement_percent": _rounded(100.0 * (1.0 - duration.sum() / reference.sum())),
        "improvement_ci95": _interval(100.0 * (1.0 - resampled[name] / resampled["naive"])),
        "mean_ratio_improvement_percent": _rounded(ratio.mean()),
        "higher": len(higher),
        "equal": len(ratio) - len(higher) - len(lower),
        "lower": len(lower),
        "mean_gain_higher_percent": _rounded(higher.mean()) if len(higher) else 0.0,
        "mean_loss_lower_percent": _rounded(-lower.mean()) if len(lower) else 0.0,
        "worst_loss_percent": _rounded(max(0.0, -ratio.min())),
        "oracle_captured_percent": None,
    }
    # Policies that also choose speeds are compared with the oracle that does.
    joint = name.endswith("_speed") and "oracle_speed" in durations
    oracle = "oracle_speed" if joint else "oracle"
    possible = reference.sum() - durations.get(oracle, reference).sum()  # s; 0 without an oracle
    if possible > _LEAST_SAVED * reference.sum():
        captured = 100.0 * (reference.sum() - duration.sum()) / possible
        summary["oracle_captured_percent"] = _rounded(captured)
        saved = resampled["naive"] - resampled[name]
        most = resampled["naive"] - resampled[oracle]
        shares = saved[most > 0.0] / most[most > 0.0]
        summary["oracle_captured_ci95"] = _interval(100.0 * shares)
    return summary


def _rounded(value: Any) -> float:
    return round(float(value), 3)


def _interval(values: FloatArray) -> list[float]:
    return [_rounded(bound) for bound in np.percentile(values, [2.5, 97.5])]


def prediction_errors(records: Sequence[Mapping[str, Any]], policy: str) -> dict[str, Any]:
    """Return the errors of a policy's predicted chain durations, over the chains that succeeded.

    `records` are those of `evaluate_trial`, `policy` is a name of `POLICIES`.

    Returns
    -------
    dict
        chains: their number; mean_error_s: mean of predicted minus actual; mean_error_ci95: its
        interval; mae_s, rmse_s: mean absolute and root mean square error; within_90_percent: how
        many percent of the durations are within their predicted 90 % interval; gain_predicted_s,
        gain_executed_s: mean gain over the naive chains that succeeded, as predicted and as
        executed. Without chains only `chains`, without naive ones no gains.
    """
    rows = [record["policies"][policy] for record in records]
    predicted = [row for row in rows if _is_predicted(row)]
    errors = np.array([row["predicted"] - row["duration"] for row in predicted])
    if not len(errors):
        return {"chains": 0}
    spreads = np.array([row["spread"] for row in predicted])
    found = {
        "chains": len(errors),
        "mean_error_s": _rounded(errors.mean()),
        "mean_error_ci95": [_rounded(bound) for bound in mean_ci95(errors)],
        "mae_s": _rounded(np.abs(errors).mean()),
        "rmse_s": _rounded(np.sqrt((errors**2).mean())),
        "within_90_percent": _rounded(100.0 * np.mean(np.abs(errors) <= _TO_90 * spreads)),
    }
    naive = [record["policies"].get("naive", {"success": False}) for record in records]
    pairs = [
        (first, row)
        for first, row in zip(naive, rows, strict=True)
        if _is_predicted(first) and _is_predicted(row)
    ]
    if pairs and policy != "naive":
        for name, key in (("gain_predicted_s", "predicted"), ("gain_executed_s", "duration")):
            gains = [first[key] - row[key] for first, row in pairs]
            found[name] = _rounded(np.mean(gains))
    return found


def _is_predicted(row: Mapping[str, Any]) -> bool:
    return bool(row["success"]) and "predicted" in row
