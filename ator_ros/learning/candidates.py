"""Training data of one measure, and candidates for the tree that predicts it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from ator_ros.experience.store import NUMBER
from ator_ros.geometry import FloatArray
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import Feature, feature_table, names_of
from ator_ros.performance.training import OUTCOMES, SMALL_LEAF, direct_of, duration_tree, small_tree
from ator_ros.performance.tree.nodes import IntArray, ModelTree
from ator_ros.robot.description import Robot

_COLUMNS = {"duration": "duration", **OUTCOMES}


class Records:
    """Starts of an action's episodes with their features, computed once.

    Parameters
    ----------
    rows : pandas.DataFrame
        The starts, oldest first, with `NUMBER`.
    robot : Robot
        For whose limits features are computed.
    features : mapping
        Features by name: the candidates, and those of models that are known.
    driving : DrivingStyle or None
        How the action drives, as far as features need it.
    """

    def __init__(
        self, rows: pd.DataFrame, robot: Robot, features: Mapping[str, Feature], driving: DrivingStyle | None
    ) -> None:
        self.rows = rows
        wanted = tuple(features.values())
        with np.errstate(all="ignore"):
            table = feature_table(direct_of(rows), robot, wanted, driving)
        self.table = pd.DataFrame(table, columns=list(names_of(wanted)))

    def data(self, measure: str) -> TrainingData:
        """Return the records with a value of a measure; for all but success, those that succeeded."""
        values = self.rows[_COLUMNS[measure]].to_numpy(dtype=float)
        usable = np.isfinite(values)
        if measure != "success":
            usable &= self.rows["success"].to_numpy(dtype=bool)
        table, numbers = self.table[usable].reset_index(drop=True), self.rows[NUMBER].to_numpy()
        return TrainingData(measure, table, values[usable], numbers[usable])


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Records of one measure, oldest first.

    Attributes
    ----------
    measure : str
        One of `MEASURES`.
    table : pandas.DataFrame
        Their features.
    values : ndarray, shape (n,)
        The measure.
    numbers : ndarray of int, shape (n,)
        See `NUMBER`.
    """

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


_SLOPES = (0.3, 3.0)
_AS_PREDICTED = 5.0  # prior weight in records; keeps few records from changing the slope
_WITHOUT_EFFECT = 10.0  # the same for a feature that adds nothing
_ROUNDS = 20
_LEAST_ERROR = 0.02  # s; smaller errors weigh no more


def scaled_to(data: TrainingData, tree: ModelTree, which: IntArray) -> ModelTree:
    """Return the tree with its times scaled and shifted to those of some records, by least absolute error."""
    x, y = data.predicted(tree, which), data.values[which]
    slope = _robust(x[:, None], y, np.ones(1), np.array([_AS_PREDICTED]))
    return _shifted(data, scaled(tree, float(np.clip(slope[0], *_SLOPES)), 0.0), which)


def corrected(data: TrainingData, tree: ModelTree, which: IntArray) -> ModelTree:
    """Return the tree scaled as by `scaled_to`, with a linear function of its features added."""
    x, y = data.predicted(tree, which), data.values[which]
    rows = data.table[list(tree.names)].to_numpy()[which]
    deviation = np.std(rows, axis=0)
    varies = deviation > 1e-6
    table = np.column_stack([x, rows[:, varies]])
    strength = np.full(table.shape[1], _WITHOUT_EFFECT)
    strength[0] = _AS_PREDICTED
    expected = np.zeros(table.shape[1])
    expected[0] = 1.0
    weights = _robust(table, y, expected, strength)
    slopes = np.zeros(len(varies))
    slopes[varies] = weights[1:]
    bent = scaled(tree, float(np.clip(weights[0], *_SLOPES)), 0.0)
    leaf = tree.is_leaf
    reach = float(np.sum(np.abs(slopes) * np.ptp(rows, axis=0)))
    center = float(np.mean(rows @ slopes))
    bent = dataclasses.replace(
        bent,
        intercept=np.where(leaf, bent.intercept - center, 0.0),
        coefficients=np.where(leaf[:, None], bent.coefficients + slopes, 0.0),
        lower=np.where(leaf, bent.lower - reach, 0.0),
        upper=np.where(leaf, bent.upper + reach, 0.0),
    )
    return _shifted(data, bent, which)


def _robust(table: FloatArray, values: FloatArray, expected: FloatArray, strength: FloatArray) -> FloatArray:
    """Return the slopes (k,) that, with a shift, fit `values` (n,) with the least absolute errors.

    `strength` (k,) is how many records the expected slopes count for. Reweighted least squares
    make outliers count little.
    """
    spread = np.maximum(np.std(table, axis=0), 1e-6)
    prior = np.column_stack([np.diag(np.sqrt(strength) * spread), np.zeros(len(spread))])
    weights: FloatArray = np.ones(len(values))
    slopes: FloatArray = expected.copy()
    scale = 1.0
    for _ in range(_ROUNDS):
        left = np.vstack([np.column_stack([table, np.ones(len(values))]) * weights[:, None], scale * prior])
        right = np.append(values * weights, scale * (prior[:, :-1] @ expected))
        solved = np.linalg.lstsq(left, right, rcond=None)[0].astype(np.float64)
        slopes = solved[:-1]
        errors = np.abs(values - table @ slopes - float(solved[-1]))
        weights = 1.0 / np.sqrt(np.maximum(errors, _LEAST_ERROR))
        scale = float(np.sqrt(np.mean(np.square(weights))))
    return slopes


def _shifted(data: TrainingData, tree: ModelTree, which: IntArray) -> ModelTree:
    return scaled(tree, 1.0, float(np.median(data.values[which] - data.predicted(tree, which))))


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
    number, zero = np.zeros(1, dtype=np.intp), np.zeros(1)
    level = np.array([value])
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


WINDOWS = (100, 300, 1000)
"""Numbers of newest records from which trees are learned: only these show how the robot changed."""
BACK = "back to "
"""Beginning of the names of candidates that were in use before."""
_RECENT = (30, 100)
"""Newest records from which corrections are estimated."""
FEWEST_LEARNED = 20
"""Records from which a tree can be learned."""
_FEWEST = 12
"""Records from which one can be corrected."""
_LEAST_LEAF = 8
"""Records in a leaf."""
_LARGE = 2000
"""Records from which learning takes so long that a tree is tested without being learned again."""


@dataclass(frozen=True)
class TreeCandidate:
    """A method that yields a tree.

    Attributes
    ----------
    name : str
        For messages.
    learn : callable
        Returns the tree learned from the records with these positions (oldest first); None if they are too
        few.
    slow : bool
        Whether to learn it once, from all but the test records, instead of once for each fold and at the end.
    """

    name: str
    learn: Callable[[IntArray], ModelTree | None]
    slow: bool = False


def candidates(
    data: TrainingData,
    names: Sequence[str],
    known: Mapping[str, ModelTree],
    former: Mapping[str, ModelTree],
) -> Iterator[TreeCandidate]:
    """Yield candidates, those that were learned from most records first.

    Parameters
    ----------
    data : TrainingData
        The records.
    names : sequence of str
        Features to learn from.
    known, former : mapping
        Trees in use, and trees that were in use before, by the names of their sets. Former ones are
        candidates as they are. For durations, copies of all of them that are scaled or corrected to fit the
        newest records are candidates too.
    """
    for name, tree in former.items():
        yield TreeCandidate(f"{BACK}{name}", partial(_kept, tree))
    count = len(data.values)
    if data.measure == "success":
        for size in (count, *reversed([size for size in WINDOWS if size < 0.8 * count])):
            yield TreeCandidate(f"the rate of {size} episodes", partial(_rate, data, size))
    for size in (count, *reversed([size for size in WINDOWS if size < 0.8 * count])):
        learn = partial(_learned, data, list(names), size)
        yield TreeCandidate(f"learned from {size} episodes", learn, slow=size > _LARGE)
    if data.measure != "duration":
        return
    for name, tree in {**known, **former}.items():
        for size in _RECENT:
            if size == _RECENT[0] or count > _RECENT[0]:
                records = f"to {min(size, count)} episodes"
                yield TreeCandidate(
                    f"{name} corrected {records}", partial(_fitted, corrected, data, tree, size)
                )
                yield TreeCandidate(f"{name} scaled {records}", partial(_fitted, scaled_to, data, tree, size))


def _kept(tree: ModelTree, _: IntArray) -> ModelTree:
    return tree


def _rate(data: TrainingData, size: int, which: IntArray) -> ModelTree:
    """Return a constant tree of the success rate: a few failures are too few to learn where they occur."""
    values = data.values[which[-size:]]
    return constant(data.table.columns[0], float(np.mean(values)), len(values))


def _learned(data: TrainingData, names: list[str], size: int, which: IntArray) -> ModelTree | None:
    which = which[-size:]
    if len(which) < FEWEST_LEARNED:
        return None
    table, values = data.table[names].iloc[which], data.values[which]
    if data.measure == "duration":
        return duration_tree(table, values)
    # Failures are rare, so small leaves are allowed.
    leaf = int(np.clip(len(which) // 6, _LEAST_LEAF, SMALL_LEAF))
    return small_tree(table, values, leaf=leaf)


def _fitted(
    fit: Callable[[TrainingData, ModelTree, IntArray], ModelTree],
    data: TrainingData,
    tree: ModelTree,
    size: int,
    which: IntArray,
) -> ModelTree | None:
    which = which[-size:]
    return fit(data, tree, which) if len(which) >= _FEWEST else None
