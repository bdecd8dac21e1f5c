"""Select the tree that best predicts a measure of an action, if it is significantly better."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import theilslopes

from ator_ros.bases.description import Robot
from ator_ros.experience.store import NUMBER
from ator_ros.geometry import FloatArray, IntArray
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import Feature
from ator_ros.performance.model import MEASURES
from ator_ros.performance.observation import part_times
from ator_ros.performance.training import (
    OUTCOMES,
    SMALL_LEAF,
    duration_tree,
    features_of,
    small_tree,
)
from ator_ros.performance.tree.nodes import ModelTree

_COLUMNS = {"duration": "duration", **OUTCOMES}
# newest records from which trees are learned, in case the robot changed
_WINDOWS = (1000, 300, 100)
_FEWEST_LEARNED = 20  # records from which a tree can be learned
_RECENT = (30, 100)  # numbers of newest records to which trees are scaled
_FEWEST_SCALED = 12
_SLOPES = (0.3, 3.0)
_LEAST_LEAF = 8  # records in a leaf

Learn = Callable[[IntArray], ModelTree | None]
"""Returns a tree learned from the records at these positions, oldest first; None if they are too few."""


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Records of one of `MEASURES`, oldest first: features, values (n,) of the measure, and `NUMBER` (n,).

    `parts`: see `part_times`; None with a map, and for other measures than the duration.
    """

    measure: str
    table: pd.DataFrame
    values: FloatArray
    numbers: IntArray
    parts: FloatArray | None

    def predicted(self, tree: ModelTree, which: IntArray) -> FloatArray:
        """Return a tree's predictions for some of the records."""
        values = tree.predict(self.table[list(tree.names)].to_numpy()[which])
        return np.clip(values, 0.0, 1.0) if self.measure == "success" else np.maximum(values, 0.0)

    def losses(self, predicted: FloatArray, which: IntArray) -> FloatArray:
        """Return the losses of predictions: absolute errors, of success squared ones (Brier score)."""
        errors = np.abs(self.values[which] - predicted)
        return errors * errors if self.measure == "success" else errors


def training_data(
    rows: pd.DataFrame, robot: Robot, features: Sequence[Feature], driving: DrivingStyle | None
) -> dict[str, TrainingData]:
    """Return the records of each measure: for success all of them, for the others those that succeeded.

    `rows` are the starts of an action's episodes, oldest first, with `NUMBER`; `driving` is how the
    action drives, if features depend on it.
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
        by_parts = measure == "duration" and robot.grid is None
        parts = part_times(rows[usable]) if by_parts else None
        found[measure] = TrainingData(measure, part, values[usable], numbers[usable], parts)
    return found


def _candidates(
    data: TrainingData,
    names: Sequence[str],
    current: ModelTree | None,
    former: Mapping[str, ModelTree],
) -> dict[str, Learn]:
    """Return candidates by name, those that are learned from most records first; see `judge`."""
    count = len(data.values)
    sizes = (count, *(size for size in _WINDOWS if size < 0.8 * count))
    found: dict[str, Learn] = {
        f"back to {name}": partial(_kept, tree) for name, tree in former.items()
    }
    if data.measure == "success":
        found |= {f"the rate of {size} episodes": partial(_rate, data, size) for size in sizes}
    found |= {
        f"learned from {size} episodes": partial(_learned, data, names, size) for size in sizes
    }
    if data.measure == "duration":
        present = {"the present model": current} if current is not None else {}
        for name, tree in (present | dict(former)).items():
            for size in sorted({min(size, count) for size in _RECENT}):
                found[f"{name} scaled to {size} episodes"] = partial(_scaled_to, data, tree, size)
    return found


def _kept(tree: ModelTree, _: IntArray) -> ModelTree:
    return tree


def _rate(data: TrainingData, size: int, which: IntArray) -> ModelTree:
    """Return a constant tree of the success rate: a few failures do not show where they occur."""
    return constant_tree(data.table.iloc[which[-size:]], data.values[which[-size:]])


def _learned(
    data: TrainingData, names: Sequence[str], size: int, which: IntArray
) -> ModelTree | None:
    which = which[-size:]
    if len(which) < _FEWEST_LEARNED:
        return None
    table, values = data.table[list(names)].iloc[which], data.values[which]
    if data.measure == "duration":
        return duration_tree(table, values, None if data.parts is None else data.parts[which])[0]
    # Failures are rare, so small leaves are allowed.
    leaf = int(np.clip(len(which) // 6, _LEAST_LEAF, SMALL_LEAF))
    return small_tree(table, values, leaf=leaf)


def _scaled_to(data: TrainingData, tree: ModelTree, size: int, which: IntArray) -> ModelTree | None:
    """Return the tree scaled and shifted to the newest records, by medians, which outliers hardly change."""
    which = which[-size:]
    if len(which) < _FEWEST_SCALED:
        return None
    x, y = data.predicted(tree, which), data.values[which]
    slope = float(np.clip(theilslopes(y, x)[0], *_SLOPES)) if np.ptp(x) > 0.0 else 1.0
    shift, leaf = float(np.median(y - slope * x)), tree.is_leaf
    return dataclasses.replace(
        tree,
        intercept=np.where(leaf, slope * tree.intercept + shift, 0.0),
        coefficients=slope * tree.coefficients,
        lower=np.where(leaf, slope * tree.lower + shift, 0.0),
        upper=np.where(leaf, slope * tree.upper + shift, 0.0),
        spread=slope * tree.spread,
        base=tuple(dataclasses.replace(hinge, slope=slope * hinge.slope) for hinge in tree.base),
    )


def constant_tree(table: pd.DataFrame, values: FloatArray) -> ModelTree:
    """Return a tree over features (n, k) that predicts the mean of values (n,) everywhere."""
    return small_tree(table, np.full(len(values), np.mean(values)))


# The choice


_TESTED = (25, 100)  # newest records to compare trees on: few show changes soon, many small gains
_FEWEST_TESTED = 12
_LEVEL = 0.05  # significance level over all candidates of one round
_FOLDS = 3
_EARLIER = 300
_NO_LOSS = 1e-9
_AS_GOOD = 0.05  # p-value above which one candidate counts as no better than another
_DRAWS = 5000


@dataclass(frozen=True)
class RoundVerdict:
    """Result of a round of learning for one measure of an action, with the number of its records `episodes`.

    Attributes
    ----------
    reason : str
        Why the tree is kept or replaced, with the mean losses of the tree in use and of the best
        candidate: absolute errors (s, m, rad), for success the Brier score.
    kind, tree
        Name and tree of the better candidate, if any; spreads of durations are as large as its
        errors on the tested records.
    tested, errors : ndarray or None
        Positions of the tested records, and their values less those predicted by the candidate
        without them.
    """

    episodes: int
    reason: str
    kind: str = ""
    tree: ModelTree | None = None
    tested: IntArray | None = None
    errors: FloatArray | None = None


def judge(
    data: TrainingData,
    names: Sequence[str],
    *,
    current: ModelTree | None,
    seen: int,
    former: Mapping[str, ModelTree],
) -> RoundVerdict:
    """Compare the tree of a measure with all candidates on the newest records, which are new to it.

    These are split into folds. Each fold is predicted by candidates learned from all other records.
    A better candidate is learned again from all records. For durations, former trees and the
    current one are also candidates when scaled and shifted to the newest records.

    Parameters
    ----------
    names : sequence of str
        The features to learn from.
    current : ModelTree or None
        The tree in use.
    seen : int
        The number from which on records are new to it.
    former : mapping of str to ModelTree
        Trees that were in use before, by the names of their sets: they are candidates as they are.
    """
    count = len(data.values)
    everything = np.arange(count)
    test = np.flatnonzero(data.numbers >= seen)[-max(_TESTED) :][::-1]  # newest first
    if len(test) < _FEWEST_TESTED:
        kind = "" if data.measure == "success" else " that succeeded"
        return RoundVerdict(
            count, f"too few new records: {len(test)}, expected {_FEWEST_TESTED}{kind}"
        )
    learners = _candidates(data, names, current, former)
    predicted = {name: _held_out(data, learn, test) for name, learn in learners.items()}
    predicted = {name: values for name, values in predicted.items() if np.isfinite(values).all()}
    if not predicted:
        rest = count - math.ceil(len(test) / _FOLDS)
        reason = (
            f"too few records: {rest} without those that are predicted, expected {_FEWEST_LEARNED}"
        )
        return RoundVerdict(count, reason)
    if data.measure == "success" and current is not None:
        # Chains predicted to fail are no longer executed, so on the newest records alone a tree
        # that predicts no failures would appear better.
        earlier = everything[-_EARLIER:]
        most = _mean_loss(data, current, earlier) + _NO_LOSS
        trees = {name: learners[name](everything) for name in predicted}
        predicted = {
            name: predicted[name]
            for name, tree in trees.items()
            if tree is not None and _mean_loss(data, tree, earlier) <= most
        }
        if not predicted:
            return RoundVerdict(count, "no better: all candidates predict earlier failures worse")
    before = data.losses(_baseline(data, current, test), test)
    losses = np.column_stack([data.losses(values, test) for values in predicted.values()])
    sizes = sorted({min(size, len(test)) for size in _TESTED})
    for size in sizes:
        number, chance, is_better = _best(before[:size], losses[:size], _LEVEL / len(sizes))
        if is_better:
            break
    name, unit = list(predicted)[number], MEASURES[data.measure]
    old, new = float(np.mean(before[:size])), float(np.mean(losses[:size, number]))
    figures = f"{old:.3g} to {new:.3g}{unit and f' {unit}'} on {size} records"
    loss = "Brier score" if data.measure == "success" else "error"
    if not is_better:
        reason = f"no better: {name} would change the {loss} from {figures} (chance {chance:.3f})"
        return RoundVerdict(count, reason)
    tree = learners[name](everything)
    assert tree is not None  # it was learned from fewer records
    tested = test[:size]
    errors = data.values[tested] - predicted[name][:size]
    if data.measure == "duration":
        # Its spreads are usually as large as these errors, by a measure that is robust against
        # outliers.
        spread = 1.4826 * float(np.median(np.abs(errors)))
        leaves = tree.apply(data.table.iloc[tested][list(tree.names)].to_numpy())
        usual = float(np.median(tree.spread[leaves]))
        spreads = (
            tree.spread * (spread / usual) if usual > 0.0 else np.full_like(tree.spread, spread)
        )
        tree = dataclasses.replace(tree, spread=spreads)
    return RoundVerdict(count, f"{name}: {loss} from {figures}", name, tree, tested, errors)


def _held_out(data: TrainingData, learn: Learn, test: IntArray) -> FloatArray:
    """Return predictions of the tested records, each fold by a tree of all others.

    NaN if there is none.
    """
    predicted = np.full(len(test), np.nan)
    for fold in range(_FOLDS):
        part = slice(fold, None, _FOLDS)
        tree = learn(np.setdiff1d(np.arange(len(data.values)), test[part], assume_unique=True))
        if tree is not None:
            predicted[part] = data.predicted(tree, test[part])
    return predicted


def _mean_loss(data: TrainingData, tree: ModelTree, which: IntArray) -> float:
    return float(np.mean(data.losses(data.predicted(tree, which), which)))


def _baseline(data: TrainingData, current: ModelTree | None, test: IntArray) -> FloatArray:
    """Return the predictions of the tree in use.

    Without one, the best constant of the other records.
    """
    if current is not None:
        return data.predicted(current, test)
    others = np.setdiff1d(np.arange(len(data.values)), test)
    values = data.values[others if len(others) >= _FEWEST_TESTED else slice(None)]
    middle = np.mean(values) if data.measure == "success" else np.median(values)
    return np.full(len(test), float(middle))


def _best(before: FloatArray, losses: FloatArray, level: float) -> tuple[int, float, bool]:
    """Return the number of the best candidate, its p-value, and whether it is significantly better."""
    # Of those that are about as good as the best it is the first, which was learned from most
    # records.
    chances, means = _p_values(before, losses), losses.mean(axis=0)
    better = np.flatnonzero((means < before.mean()) & (chances < level)).tolist()
    best = min(better or range(len(means)), key=lambda number: float(means[number]))
    for number in better:
        if _p_values(losses[:, number], losses[:, [best]])[0] >= _AS_GOOD:
            best = number
            break
    return best, float(chances[best]), bool(better)


def _p_values(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return p-values (k,) of k models with losses `after` (n, k), corrected for their number."""
    # A sign-flip permutation test against the losses `before` (n,): it assumes no distribution, so
    # outliers hardly matter. All models have the same signs, and the p-value is that of the
    # greatest statistic (Westfall and Young 1993), so many similar candidates are corrected for
    # like one.
    gain = before[:, None] - after
    gain = gain / np.maximum(np.sqrt(np.sum(gain * gain, axis=0)), 1e-12)
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (_DRAWS, len(gain)))
    greatest = np.max(signs @ gain, axis=1)
    beyond = np.sum(greatest[:, None] >= gain.sum(axis=0) - 1e-12, axis=0)
    return np.asarray((1.0 + beyond) / (_DRAWS + 1.0))
