"""How accurate predictions are on fresh episodes, as the paper measures it (end of section 3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions.situation import SHORT
from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import Geometry
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import direct_of
from ator_ros.robot.description import Robot
from ator_ros.world.state import AT_REST, CONTROL_PERIOD

RESAMPLES = 5000


def resampled_means(table: FloatArray) -> FloatArray:
    """Return means, shape (k, RESAMPLES), over columns of a table (k, n) drawn with replacement."""
    count = table.shape[1]
    weights = np.random.default_rng(0).multinomial(
        count, np.full(count, 1.0 / count), size=RESAMPLES
    )
    return np.asarray(table @ weights.T / count)


def mean_ci95(values: FloatArray) -> FloatArray:
    """Return the 95 % bootstrap interval, shape (2,), of the mean of independent `values`, shape (n,)."""
    return np.quantile(resampled_means(values[None, :]), (0.025, 0.975))


def accuracy(model: PerformanceModel, starts: pd.DataFrame, *, seed: int) -> dict[str, Any]:
    """Compare predicted and actual durations, from the first rows of fresh episodes.

    Returns
    -------
    dict
        mae_s, rmse_s with their _ci95, bias_s, mean_duration_s, relative_error (MAE over mean
        duration), median_relative_error; the number of episodes, which are those that succeeded,
        and their seed.
    """
    starts = starts[starts["success"]]
    actual = starts["duration"].to_numpy(dtype=float)
    predicted = model.predict(direct_of(starts)).duration
    assert predicted is not None
    error = predicted - actual
    square, size = error * error, np.abs(error)
    return {
        "mae_s": float(size.mean()),
        "mae_s_ci95": mean_ci95(size).tolist(),
        "rmse_s": float(np.sqrt(square.mean())),
        "rmse_s_ci95": np.sqrt(mean_ci95(square)).tolist(),
        "bias_s": float(error.mean()),
        "mean_duration_s": float(actual.mean()),
        "relative_error": float(size.mean() / max(actual.mean(), CONTROL_PERIOD)),
        "median_relative_error": float(np.median(size / np.maximum(actual, CONTROL_PERIOD))),
        "episodes": len(starts),
        "seed": seed,
    }


def brier(model: PerformanceModel, starts: pd.DataFrame, *, seed: int) -> dict[str, Any]:
    """Compare the Brier score of predicted success with that of the success rate, from fresh first rows."""
    happened = starts["success"].to_numpy(dtype=float)
    probability = model.predict(direct_of(starts), ("success",)).success
    assert probability is not None
    rate = float(happened.mean())
    better = (rate - happened) ** 2 - (probability - happened) ** 2
    return {
        "brier": float(((probability - happened) ** 2).mean()),
        "brier_base_rate": float(((rate - happened) ** 2).mean()),
        "brier_gain_ci95": mean_ci95(better).tolist(),
        "success_rate": rate,
        "episodes": len(starts),
        "seed": seed,
    }


def kinds(starts: pd.DataFrame, robot: Robot) -> dict[str, pd.DataFrame]:
    """Return the starts at rest and not near the goal, those near it, and those in motion."""
    rest = (starts["v"].abs() <= AT_REST.v).to_numpy()
    near = Geometry(direct_of(starts), robot).dist < SHORT
    masks = {
        "at rest": rest & ~near,
        f"turns, and drives below {SHORT:g} m": rest & near,
        "in motion": ~rest,
    }
    return {name: starts[mask] for name, mask in masks.items()}
