"""How accurate predictions are on fresh episodes, as the paper measures it (end of section 3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions.situation import SHORT
from ator_ros.bases.description import Robot
from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import Geometry
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import direct_of
from ator_ros.world.state import AT_REST, CONTROL_PERIOD

RESAMPLES = 5000  # bootstrap samples


def resampled_means(table: FloatArray) -> FloatArray:
    """Return bootstrap means of the rows of a table.

    Columns are drawn with replacement, the same ones for all rows. The seed is fixed.

    Parameters
    ----------
    table : array of float, shape (k, n)

    Returns
    -------
    array of float, shape (k, RESAMPLES)
    """
    count = table.shape[1]
    weights = np.random.default_rng(0).multinomial(
        count, np.full(count, 1.0 / count), size=RESAMPLES
    )
    return np.asarray(table @ weights.T / count)


def mean_ci95(values: FloatArray) -> FloatArray:
    """Return the 95 % bootstrap interval of a mean, shape (2,): lower and upper bound.

    `values`, shape (n,), are independent.
    """
    return np.quantile(resampled_means(values[None, :]), (0.025, 0.975))


def accuracy(
    model: PerformanceModel,
    starts: pd.DataFrame,
    *,
    seed: int,
) -> dict[str, Any]:
    """Compare predicted with actual durations of fresh episodes (paper, end of section 3).

    Only episodes that succeeded count.

    Parameters
    ----------
    model : PerformanceModel
    starts : pandas.DataFrame
        First rows of episodes that the model was not learned from.
    seed : int
        Seed of these episodes, for the record.

    Returns
    -------
    dict
        mae_s, rmse_s with their _ci95, bias_s, mean_duration_s, relative_error (MAE over mean
        duration), median_relative_error; the number of episodes and their seed.
    """
    starts = starts[starts["success"]]
    actual = starts["duration"].to_numpy(dtype=float)
    predicted = model.predict(direct_of(starts)).duration
    assert predicted is not None
    error = predicted - actual
    square = error * error
    size = np.abs(error)
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


def brier(
    model: PerformanceModel,
    starts: pd.DataFrame,
    *,
    seed: int,
) -> dict[str, Any]:
    """Compare the Brier scores of predicted success and of the success rate on fresh episodes.

    Parameters
    ----------
    model : PerformanceModel
    starts : pandas.DataFrame
        First rows of episodes that the model was not learned from.
    seed : int
        Seed of these episodes, for the record.

    Returns
    -------
    dict
        brier, brier_base_rate, brier_gain_ci95 (their difference; positive if the model is better),
        success_rate, and the number of episodes with their seed.
    """
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
    """Divide first rows of episodes into kinds, by the name of the kind.

    Episodes start at rest and away from the goal, at rest and near it, or in motion.
    """
    rest = (starts["v"].abs() <= AT_REST.speed).to_numpy()
    near = Geometry(direct_of(starts), robot).dist < SHORT
    masks = {
        "at rest": rest & ~near,
        f"turns, and drives below {SHORT:g} m": rest & near,
        "in motion": ~rest,
    }
    return {name: starts[mask] for name, mask in masks.items()}
