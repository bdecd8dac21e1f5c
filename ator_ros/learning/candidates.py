"""Training data of one measure, and candidates for the tree that predicts it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import theilslopes

from ator_ros.experience.store import NUMBER
from ator_ros.geometry import FloatArray
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import Feature
from ator_ros.performance.model import MEASURES
from ator_ros.performance.training import OUTCOMES, SMALL_LEAF, duration_tree, features_of, small_tree
from ator_ros.performance.tree.nodes import IntArray, ModelTree
from ator_ros.robot.description import Robot

_COLUMNS = {"duration": "duration", **OUTCOMES}
_WINDOWS = (1000, 300, 100)
"""Numbers of newest records from which trees are learned: only these show how the robot changed."""
FEWEST_LEARNED = 20
"""Records from which a tree can be learned."""
_RECENT = (30, 100)
"""Numbers of newest records to which trees are scaled."""
_FEWEST_SCALED = 12
_SLOPES = (0.3, 3.0)
_LEAST_LEAF = 8
"""Records in a leaf."""

Learn = Callable[[IntArray], ModelTree | None]
"""Returns a tree learned from the records at these positions, oldest first; None if they are too few."""


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Records of one of `MEASURES`, oldest first: features, values (n,) of the measure, and `NUMBER` (n,)."""

    measure: str
    table: pd.DataFrame
    values: FloatArray
    numbers: IntArray

    def predicted(self, tree: ModelTree, which: IntArray) -> FloatArray:
        """Return a tree's predictions for some of the records."""
        values = tree.predict(np.ascontiguousarray(self.table[list(tree.names)].to_numpy()[which]))
        return np.clip(values, 0.0, 1.0) if self.measure == "success" else np.maximum(values, 0.0)

    def losses(self, predicted: FloatArray, which: IntArray) -> FloatArray:
        """Return the losses of predictions: absolute errors, of success squared ones (Brier score)."""
        errors = np.abs(self.values[which] - predicted)
        return errors * errors if self.measure == "success" else errors


def training_data(
    rows: pd.DataFrame, robot: Robot, features: Sequence[Feature], driving: DrivingStyle | None
) -> dict[str, TrainingData]:
    """Return the records of each measure: of all but success, those that succeeded.

    `rows` are the starts of an action's episodes, oldest first, with `NUMBER`; `driving` is how the action
    drives, as far as features need it.
    """
    with np.errstate(all="ignore"):
        table = features_of(rows, robot, features, driving)
    found = {}
    for measure in MEASURES:
        values = rows[_COLUMNS[measure]].to_numpy(dtype=float)
        usable = np.isfinite(values)
        if measure != "success":
            usable &= rows["success"].to_numpy(dtype=bool)
        part, numbers = table[usable].reset_index(drop=True), rows[NUMBER].to_numpy()
        found[measure] = TrainingData(measure, part, values[usable], numbers[usable])
    return found


def candidates(
    data: TrainingData, names: Sequence[str], current: ModelTree | None, former: Mapping[str, ModelTree]
) -> dict[str, Learn]:
    """Return candidates by name, those that were learned from most records first.

    `names` are the features to learn from, `former` the trees that were in use before, by the names of their
    sets: they are candidates as they are. For durations, copies of the trees in use and before that are
    scaled and shifted to the newest records are candidates too.
    """
    count = len(data.values)
    sizes = (count, *(size for size in _WINDOWS if size < 0.8 * count))
    found: dict[str, Learn] = {f"back to {name}": partial(_kept, tree) for name, tree in former.items()}
    if data.measure == "success":
        found |= {f"the rate of {size} episodes": partial(_rate, data, size) for size in sizes}
    found |= {f"learned from {size} episodes": partial(_learned, data, names, size) for size in sizes}
    if data.measure == "duration":
        present = {"the present model": current} if current is not None else {}
        for name, tree in (present | dict(former)).items():
            for size in sorted({min(size, count) for size in _RECENT}):
                found[f"{name} scaled to {size} episodes"] = partial(_scaled_to, data, tree, size)
    return found


def _kept(tree: ModelTree, _: IntArray) -> ModelTree:
    return tree


def _rate(data: TrainingData, size: int, which: IntArray) -> ModelTree:
    """Return a constant tree of the success rate: a few failures are too few to learn where they occur."""
    values = data.values[which[-size:]]
    return constant(data.table.columns[0], float(np.mean(values)), len(values))


def _learned(data: TrainingData, names: Sequence[str], size: int, which: IntArray) -> ModelTree | None:
    which = which[-size:]
    if len(which) < FEWEST_LEARNED:
        return None
    table, values = data.table[list(names)].iloc[which], data.values[which]
    if data.measure == "duration":
        return duration_tree(table, values)
    # Failures are rare, so small leaves are allowed.
    leaf = int(np.clip(len(which) // 6, _LEAST_LEAF, SMALL_LEAF))
    return small_tree(table, values, leaf=leaf)


def _scaled_to(data: TrainingData, tree: ModelTree, size: int, which: IntArray) -> ModelTree | None:
    """Return the tree scaled and shifted to the newest records; medians, so that outliers do not matter."""
    which = which[-size:]
    if len(which) < _FEWEST_SCALED:
        return None
    x, y = data.predicted(tree, which), data.values[which]
    slope = float(np.clip(theilslopes(y, x)[0], *_SLOPES)) if np.ptp(x) > 0.0 else 1.0
    return scaled(tree, slope, float(np.median(y - slope * x)))


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


def constant(name: str, value: float, samples: int) -> ModelTree:
    """Return a tree over the feature `name` that predicts the same everywhere."""
    number, zero, level = np.zeros(1, dtype=np.intp), np.zeros(1), np.array([value])
    return ModelTree(
        names=(name,),
        feature=number,
        threshold=zero,
        children=np.zeros((1, 2), dtype=np.intp),
        intercept=level,
        coefficients=np.zeros((1, 1)),
        lower=level,
        upper=level,
        spread=zero,
        samples=np.array([float(samples)]),
    )
