"""Models worth trying in place of the one that is there."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from ator_ros.geometry import FloatArray
from ator_ros.performance.features import Feature
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.training import TrainingError, direct_of, train
from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.robot.description import Robot

WINDOWS = (100, 300, 1000)
"""Newest records from which a model is learned; a change of the robot shows in the records after it."""
_RECENT = (30, 100)  # newest records from which the overall change of the times is estimated
_FEWEST = 12
_SLOPES = (0.3, 3.0)
BACK = "back to "
"""How the name of a candidate begins that was in use before."""


def candidates(
    action: str,
    rows: pd.DataFrame,
    robot: Robot,
    features: Sequence[Feature],
    known: Mapping[str, PerformanceModel],
) -> Iterator[tuple[str, PerformanceModel]]:
    """Yield names of models, and the models, that were learned from the starts of episodes in `rows`.

    Those that know most come first.

    Parameters
    ----------
    action : str
        Name of the action.
    rows : pandas.DataFrame
        Starts of episodes, oldest first.
    robot, features
        As for `train`.
    known : mapping
        Models used now or earlier, by the names of their sets. A copy of each, with its times scaled and
        shifted to fit the newest records, is a candidate too.
    """
    sizes = [size for size in WINDOWS if size < 0.8 * len(rows)]
    for size in (len(rows), *reversed(sizes)):
        try:
            model = train(action, rows[-size:], robot, features=features)
        except TrainingError:
            continue
        yield f"learned from {size} episodes", model
    good = rows[rows["success"]]
    for name, model in known.items():
        for size in dict.fromkeys(min(size, len(good)) for size in _RECENT):
            if size >= _FEWEST:
                yield f"{name} scaled to {size} episodes", _scaled_to(model, good[-size:])


def predicted(model: PerformanceModel, rows: pd.DataFrame) -> FloatArray:
    """Return the predicted durations (n,) of starts of episodes, in s."""
    with np.errstate(all="ignore"):
        durations = model.predict(direct_of(rows)).duration
    assert durations is not None
    return durations


def _scaled_to(model: PerformanceModel, rows: pd.DataFrame) -> PerformanceModel:
    """Return the model with its times scaled and shifted to those of `rows`, by least absolute error."""
    x, y = predicted(model, rows), rows["duration"].to_numpy(dtype=float)
    weights = np.ones(len(x))
    slope, shift = 1.0, 0.0
    for _ in range(20):  # iteratively reweighted, so that single chains that went wrong don't count
        table = np.column_stack([x, np.ones(len(x))]) * weights[:, None]
        # As if five more records had gone as predicted: few records shall not turn the slope.
        prior = np.array([[np.sqrt(5.0) * max(float(np.std(x)), 1e-6), 0.0]])
        left, right = np.vstack([table, prior]), np.append(y * weights, prior[0, 0])
        slope, shift = np.linalg.lstsq(left, right, rcond=None)[0]
        weights = 1.0 / np.sqrt(np.maximum(np.abs(y - slope * x - shift), 0.02))
    slope = float(np.clip(slope, *_SLOPES))
    shift = float(np.median(y - slope * x))
    return dataclasses.replace(
        model, trees={**model.trees, "duration": scaled(model.trees["duration"], slope, shift)}
    )


def scaled(tree: ModelTree, slope: float, shift: float) -> ModelTree:
    """Return a tree that predicts `slope` (above 0) times as much as another, and `shift` more."""
    leaf = tree.is_leaf
    return dataclasses.replace(
        tree,
        intercept=np.where(leaf, slope * tree.intercept + shift, 0.0),
        coefficients=slope * tree.coefficients,
        lower=np.where(leaf, slope * tree.lower + shift, 0.0),
        upper=np.where(leaf, slope * tree.upper + shift, 0.0),
        spread=slope * tree.spread,
    )


def with_honest_spread(model: PerformanceModel, rows: pd.DataFrame) -> PerformanceModel:
    """Return the model with spreads as large as its errors on `rows`, which it has not seen."""
    prediction = model.predict(direct_of(rows))
    assert prediction.duration is not None
    assert prediction.spread is not None
    errors = rows["duration"].to_numpy(dtype=float) - prediction.duration
    usual = 1.4826 * float(np.median(np.abs(errors)))  # not what single chains that went wrong make it
    expected = float(np.median(prediction.spread))
    factor = float(np.clip(usual / expected, 0.5, 10.0)) if expected > 0.0 else 1.0
    tree = model.trees["duration"]
    tree = dataclasses.replace(tree, spread=factor * tree.spread)
    return dataclasses.replace(model, trees={**model.trees, "duration": tree})


def plausible(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the episodes whose durations can be true; a record may lie."""
    durations = rows["duration"].to_numpy(dtype=float)
    usual = float(np.median(durations)) if len(durations) else 0.0
    return rows[(durations > 0.0) & (durations < max(10.0 * usual, 1.0))]
