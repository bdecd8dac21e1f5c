"""The statistics of Table 1 and others from the records of an evaluation (paper, section 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ator_ros.geometry import FloatArray

EQUAL = 0.02
"""Runs whose durations differ by no more than this share count as equal."""
_WORTH_SHARING = 0.0005
"""Share of the naive durations that the oracle saves, below which captured shares are not reported."""
RESAMPLES = 5000
LABELS = ("Higher", "Equal", "Lower")


@dataclass(frozen=True)
class Outcomes:
    """Durations of all policies in the same situations.

    Attributes
    ----------
    duration : dict of ndarray, shape (n,)
        In s by policy, with the time limit for a failed chain; includes "oracle" and "oracle_speed" if they
        were executed.
    success : dict of ndarray of bool, shape (n,)
        By policy.
    """

    duration: Mapping[str, FloatArray]
    success: Mapping[str, NDArray[np.bool_]]


def outcomes(records: Sequence[Mapping[str, Any]]) -> Outcomes:
    """Return the outcomes in records of `evaluate_trial`."""
    duration: dict[str, FloatArray] = {}
    success: dict[str, NDArray[np.bool_]] = {}
    for name in records[0]["policies"]:
        rows = [record["policies"][name] for record in records]
        duration[name] = np.array([row["duration"] for row in rows], dtype=float)
        success[name] = np.array([row["success"] for row in rows], dtype=bool)
    for name in ("oracle", "oracle_speed"):
        if name in records[0]:
            duration[name] = np.array([record[name]["best"] for record in records], dtype=float)
            success[name] = np.array([record[name]["success"] for record in records], dtype=bool)
    return Outcomes(duration, success)


def labels(duration: FloatArray, reference: FloatArray) -> NDArray[np.str_]:
    """Label the performance of each run against the reference: Higher, Equal (within 2 %) or Lower."""
    gain = (reference - duration) / reference
    return np.where(gain > EQUAL, LABELS[0], np.where(gain < -EQUAL, LABELS[2], LABELS[1]))


def summarise(results: Outcomes) -> dict[str, dict[str, Any]]:
    """Return for each policy the figures of Table 1, with 95 % bootstrap intervals over situations.

    Returns
    -------
    dict
        By policy: mean_duration_s, improvement_percent (of the sums, against naive), improvement_ci95,
        mean_ratio_improvement_percent (mean of the runs' own percentages) and its interval, higher, equal,
        lower (runs), mean_gain_higher_percent, mean_loss_lower_percent, oracle_captured_percent and its
        interval, failures, worst_loss_percent.
    """
    names = list(results.duration)
    table = np.stack([results.duration[name] for name in names])
    resampled = _resampled_means(table)
    row = {name: index for index, name in enumerate(names)}
    return {name: _policy_summary(name, row, table, resampled, results) for name in names}


def _resampled_means(table: FloatArray) -> FloatArray:
    """Return the means, shape (policies, resamples), over situations drawn with replacement."""
    rng = np.random.default_rng(0)
    count = table.shape[1]
    weights = rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES)
    return np.asarray(table @ weights.T / count)


def _policy_summary(
    name: str, row: Mapping[str, int], table: FloatArray, resampled: FloatArray, results: Outcomes
) -> dict[str, Any]:
    index, naive = row[name], row["naive"]
    duration, reference = table[index], table[naive]
    ratio = 100.0 * (reference - duration) / reference
    label = labels(duration, reference)
    higher, lower = ratio[label == "Higher"], ratio[label == "Lower"]
    ratios = _resampled_means(ratio[None, :])[0]
    summary: dict[str, Any] = {
        "mean_duration_s": _rounded(duration.mean()),
        "improvement_percent": _rounded(100.0 * (1.0 - duration.sum() / reference.sum())),
        "improvement_ci95": _interval(100.0 * (1.0 - resampled[index] / resampled[naive])),
        "mean_ratio_improvement_percent": _rounded(ratio.mean()),
        "mean_ratio_improvement_ci95": _interval(ratios),
        "higher": len(higher),
        "equal": int(np.sum(label == "Equal")),
        "lower": len(lower),
        "mean_gain_higher_percent": _rounded(higher.mean()) if len(higher) else 0.0,
        "mean_loss_lower_percent": _rounded(-lower.mean()) if len(lower) else 0.0,
        "worst_loss_percent": _rounded(max(0.0, -ratio.min())),
        "failures": int(np.sum(~results.success[name])),
        "oracle_captured_percent": None,
        "oracle_captured_ci95": None,
    }
    if "oracle" in row:
        best = row["oracle"]
        possible = reference.sum() - table[best].sum()
        if possible > _WORTH_SHARING * reference.sum():
            captured = (reference.sum() - duration.sum()) / possible
            summary["oracle_captured_percent"] = _rounded(100.0 * captured)
            with np.errstate(invalid="ignore", divide="ignore"):  # a resample may have nothing to gain
                shares = (resampled[naive] - resampled[index]) / (resampled[naive] - resampled[best])
            summary["oracle_captured_ci95"] = _interval(100.0 * shares)
    return summary


def _rounded(value: Any) -> float:
    return round(float(value), 3)


def _interval(values: FloatArray) -> list[float]:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return [0.0, 0.0]
    return [_rounded(bound) for bound in np.percentile(finite, [2.5, 97.5])]


def mean_interval(values: FloatArray) -> list[float]:
    """Return the 95 % bootstrap interval of the mean of `values`, shape (n,)."""
    return _interval(_resampled_means(values[None, :])[0])


def prediction_errors(records: Sequence[Mapping[str, Any]], policy: str) -> dict[str, Any]:
    """Return the errors of a policy's predicted chain durations, over the chains that succeeded.

    Returns
    -------
    dict
        chains: their number; mean_error_s: mean of predicted minus actual; mean_error_ci95: its interval;
        mae_s, rmse_s: mean absolute and root mean square error. Without chains only `chains`.
    """
    rows = [record["policies"][policy] for record in records]
    known = [row for row in rows if row["success"] and "predicted" in row]
    errors = np.array([row["predicted"] - row["duration"] for row in known])
    if not len(errors):
        return {"chains": 0}
    return {
        "chains": len(errors),
        "mean_error_s": _rounded(errors.mean()),
        "mean_error_ci95": mean_interval(errors),
        "mae_s": _rounded(np.abs(errors).mean()),
        "rmse_s": _rounded(np.sqrt((errors**2).mean())),
    }
