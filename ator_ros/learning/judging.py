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

from ator_ros.geometry import FloatArray, IntArray
from ator_ros.performance.model import MEASURES
from ator_ros.performance.training import SMALL_LEAF, Examples, duration_tree, small_tree
from ator_ros.performance.tree.nodes import ModelTree

_WINDOW = 200  # newest records of the second refit, in case the robot changed
_FEWEST_LEARNED = 20  # records from which a tree can be learned
_FEWEST_FIRST = 13  # likewise, of the first tree of durations: two thirds of the first twenty
_LEAST_LEAF = 8  # records in a leaf: failures are rare
_SCALED = 30  # newest records to which a tree is scaled
_FEWEST_SCALED = 12
_SLOPES = (0.3, 3.0)  # a robot that is faster or slower than that is another one
# Newest records on which trees are compared. More notice a change later; fewer miss small gains.
_TESTED = 50
# Chains predicted to fail are no longer executed, so on few records a tree that predicts no
# failures would appear better.
_TESTED_SUCCESS = 300
_FEWEST_TESTED = 12
_FOLDS = 3
_LEVEL = 0.05  # significance level over all candidates of one round
_AS_GOOD = 1.05  # times the least loss up to which candidates count as equally good
_DRAWS = 5000  # of signs: p-values of 0.05 are accurate to 0.003
_NO_GAIN = 1e-12  # rounding of a sum of gains whose squares sum to 1
_TO_DEVIATION = 1.4826  # from the median of absolute errors, for normal errors

Learn = Callable[[Examples, IntArray], ModelTree | None]
"""Returns a tree learned from the examples at these positions; None if they are too few."""


@dataclass(frozen=True, eq=False)
class RoundVerdict:
    """Result of a round of learning for one measure of an action.

    Attributes
    ----------
    episodes : int
        How many records the measure has.
    reason : str
        Why the tree is kept or replaced, with the mean losses of the tree in use and of the best
        candidate: absolute errors (s, m, rad), for success the Brier score.
    kind, tree
        Name and tree of the better candidate, if any; spreads of durations are as large as its
        errors on the tested records.
    tested, errors : ndarray or None
        Positions of the tested records among the examples, and their values less those predicted by
        the candidate without them.
    """

    episodes: int
    reason: str
    kind: str = ""
    tree: ModelTree | None = None
    tested: IntArray | None = None
    errors: FloatArray | None = None


def judge(
    examples: Examples,
    names: Sequence[str],
    *,
    new: int,
    current: ModelTree | None,
    former: Mapping[str, ModelTree],
) -> RoundVerdict:
    """Compare the tree of a measure with all candidates on the newest records.

    These are split into folds. Each fold is predicted by candidates learned from all other records.
    The best candidate replaces the tree if a paired test shows that it is better; it is learned
    again from all records.

    Parameters
    ----------
    examples : Examples
        The records of the measure, oldest first.
    names : sequence of str
        The features to learn from.
    new : int
        How many of the newest records the tree in use was not learned from. Durations and errors
        are compared on these only.
    current : ModelTree or None
        The tree in use.
    former : mapping of str to ModelTree
        Trees that were in use before, by the names of their sets: they are candidates as they are.
    """
    count = len(examples.values)
    is_success = examples.measure == "success"
    if new < _FEWEST_TESTED:
        which = "" if is_success else " that succeeded"
        reason = f"too few new records: {new}, expected {_FEWEST_TESTED}{which}"
        return RoundVerdict(count, reason)
    size = min(count, _TESTED_SUCCESS) if is_success else min(new, _TESTED)
    tested = np.arange(count - size, count)
    candidates = _candidates(examples, names, current, former)
    predicted: dict[str, FloatArray] = {}
    for name, learn in candidates.items():
        values = _held_out(examples, learn, tested)
        if np.isfinite(values).all():
            predicted[name] = values
    if not predicted:
        others = count - math.ceil(size / _FOLDS)
        which = f"{others} without those that are predicted"
        fewest = _fewest(examples, current)
        return RoundVerdict(count, f"too few records: {which}, expected {fewest}")
    keep = _constant if current is None else partial(_kept, current)
    before = _losses(examples, _held_out(examples, keep, tested), tested)
    losses = np.column_stack([_losses(examples, each, tested) for each in predicted.values()])
    means = losses.mean(axis=0)
    # The first candidate about as good as the best is the one with the fewest new parameters.
    best = int(np.argmax(means <= _AS_GOOD * means.min()))
    name = list(predicted)[best]
    chance = _p_values(before[:, None] - losses)[best]
    unit = MEASURES[examples.measure]
    change = f"{before.mean():.3g} to {means[best]:.3g}{unit and f' {unit}'} on {size} records"
    loss = "Brier score" if is_success else "error"
    if chance >= _LEVEL:
        reason = f"no better: {name} would change the {loss} from {change} (chance {chance:.3f})"
        return RoundVerdict(count, reason)
    tree = candidates[name](examples, np.arange(count))
    assert tree is not None  # it was learned from fewer records
    errors = examples.values[tested] - predicted[name]
    if examples.measure == "duration":
        tree = _with_spread(tree, examples.table.iloc[tested], errors)
    return RoundVerdict(count, f"{name}: {loss} from {change}", name, tree, tested, errors)


def constant_tree(table: pd.DataFrame, values: FloatArray) -> ModelTree:
    """Return a tree over features (n, k) that predicts the mean of values (n,) everywhere."""
    return small_tree(table, np.full(len(values), np.mean(values)))


# Candidates


def _candidates(
    examples: Examples,
    names: Sequence[str],
    current: ModelTree | None,
    former: Mapping[str, ModelTree],
) -> dict[str, Learn]:
    """Return candidates by name, those with the fewest new parameters first."""
    count = len(examples.values)
    windows = sorted({count, min(count, _WINDOW)}, reverse=True)
    found: dict[str, Learn] = {}
    for name, tree in former.items():
        if current is None or not _predict_alike(examples, tree, current):
            found[f"back to {name}"] = partial(_kept, tree)
    if examples.measure == "success":
        for size in windows:
            found[f"the rate of {size} episodes"] = partial(_constant, size=size)
    if examples.measure == "duration" and current is not None:
        found[f"the present model scaled to {_SCALED} episodes"] = partial(_scaled, current)
    for size in windows:
        fewest = _fewest(examples, current)
        found[f"learned from {size} episodes"] = partial(_learned, names, size, fewest)
    return found


def _predict_alike(examples: Examples, one: ModelTree, other: ModelTree) -> bool:
    """Return whether two trees are the same, as of sets of which another measure was replaced."""
    every = np.arange(len(examples.values))
    first = _predicted(examples, one, every)
    return np.array_equal(first, _predicted(examples, other, every))


def _fewest(examples: Examples, current: ModelTree | None) -> int:
    """Return from how many records a tree can be learned."""
    is_first = current is None and examples.measure == "duration"
    return _FEWEST_FIRST if is_first else _FEWEST_LEARNED


def _kept(tree: ModelTree, _: Examples, __: IntArray) -> ModelTree:
    return tree


def _constant(examples: Examples, which: IntArray, size: int = _WINDOW) -> ModelTree:
    """Return a constant tree: a few failures do not show where they occur."""
    which = which[-size:]
    return constant_tree(examples.table.iloc[which], examples.values[which])


def _learned(
    names: Sequence[str], size: int, fewest: int, examples: Examples, which: IntArray
) -> ModelTree | None:
    which = which[-size:]
    if len(which) < fewest:
        return None
    table = examples.table[list(names)].iloc[which]
    values = examples.values[which]
    if examples.measure == "duration":
        parts = None if examples.parts is None else examples.parts[which]
        tree, _ = duration_tree(table.reset_index(drop=True), values, examples.prior, parts)
        return tree
    leaf = int(np.clip(len(which) // 6, _LEAST_LEAF, SMALL_LEAF))
    return small_tree(table, values, leaf=leaf)


def _scaled(tree: ModelTree, examples: Examples, which: IntArray) -> ModelTree | None:
    """Return the tree scaled and shifted to the newest records, by medians."""
    which = which[-_SCALED:]
    if len(which) < _FEWEST_SCALED:
        return None
    predicted = _predicted(examples, tree, which)
    values = examples.values[which]
    slope = 1.0
    if np.ptp(predicted) > 0.0:
        slope = float(np.clip(theilslopes(values, predicted).slope, *_SLOPES))
    shift = float(np.median(values - slope * predicted))
    leaf = tree.is_leaf
    return dataclasses.replace(
        tree,
        intercept=np.where(leaf, slope * tree.intercept + shift, 0.0),
        coefficients=slope * tree.coefficients,
        lower=np.where(leaf, slope * tree.lower + shift, 0.0),
        upper=np.where(leaf, slope * tree.upper + shift, 0.0),
        base=tuple(dataclasses.replace(hinge, slope=slope * hinge.slope) for hinge in tree.base),
    )


def _with_spread(tree: ModelTree, table: pd.DataFrame, errors: FloatArray) -> ModelTree:
    """Return the tree with spreads that are usually as large as its errors, but for outliers."""
    deviation = _TO_DEVIATION * float(np.median(np.abs(errors)))
    leaves = tree.apply(table[list(tree.names)].to_numpy())
    usual = float(np.median(tree.spread[leaves]))
    equal = np.full_like(tree.spread, deviation)
    spread = equal if usual == 0.0 else tree.spread * (deviation / usual)
    return dataclasses.replace(tree, spread=spread)


# Comparison


def _predicted(examples: Examples, tree: ModelTree, which: IntArray) -> FloatArray:
    """Return the predictions of a tree for some of the examples, in the range of the measure."""
    values = tree.predict(examples.table[list(tree.names)].to_numpy()[which])
    return np.clip(values, 0.0, 1.0 if examples.measure == "success" else None)


def _held_out(examples: Examples, learn: Learn, tested: IntArray) -> FloatArray:
    """Return predictions of the tested records, each fold by a tree of all others.

    NaN if there is none.
    """
    predicted = np.full(len(tested), np.nan)
    everything = np.arange(len(examples.values))
    for fold in range(_FOLDS):
        part = slice(fold, None, _FOLDS)
        tree = learn(examples, np.setdiff1d(everything, tested[part], assume_unique=True))
        if tree is not None:
            predicted[part] = _predicted(examples, tree, tested[part])
    return predicted


def _losses(examples: Examples, predicted: FloatArray, which: IntArray) -> FloatArray:
    """Return the losses of predictions: absolute errors, of success squared ones (Brier score)."""
    errors = np.abs(examples.values[which] - predicted)
    return errors * errors if examples.measure == "success" else errors


def _p_values(gains: FloatArray) -> FloatArray:
    """Return p-values (k,) of the gains (n, k) of k candidates, corrected for their number."""
    # A sign-flip permutation test: it assumes no distribution, so outliers hardly matter. All
    # candidates have the same signs, and the p-value is that of the greatest statistic (Westfall
    # and Young 1993), so many similar candidates are corrected for like one.
    lengths = np.sqrt(np.sum(gains * gains, axis=0))
    scaled = gains / np.maximum(lengths, _NO_GAIN)
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (_DRAWS, len(scaled)))
    greatest = np.max(signs @ scaled, axis=1)
    beyond = np.sum(greatest[:, None] >= scaled.sum(axis=0) - _NO_GAIN, axis=0)
    return np.asarray((1.0 + beyond) / (_DRAWS + 1.0))
