"""Trees of times, corrected to fit few records; what they tell nothing of stays."""

from __future__ import annotations

import dataclasses

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.learning.lessons import Lessons
from ator_ros.performance.tree.nodes import IntArray, ModelTree

_SLOPES = (0.3, 3.0)
_AS_PREDICTED = 5.0  # prior weight in records; keeps few records from changing the slope
_WITHOUT_EFFECT = 10.0  # the same for a feature that adds nothing
_ROUNDS = 20
_LEAST_ERROR = 0.02  # s; smaller errors weigh no more


def scaled_to(lessons: Lessons, tree: ModelTree, which: IntArray) -> ModelTree:
    """Return the tree with its times scaled and shifted to those of some records, by least absolute error."""
    x, y = lessons.predicted(tree, which), lessons.values[which]
    slope = _robust(x[:, None], y, np.ones(1), np.array([_AS_PREDICTED]))
    return _shifted(lessons, scaled(tree, float(np.clip(slope[0], *_SLOPES)), 0.0), which)


def corrected(lessons: Lessons, tree: ModelTree, which: IntArray) -> ModelTree:
    """Return the tree scaled as by `scaled_to`, with a linear function of its features added."""
    x, y = lessons.predicted(tree, which), lessons.values[which]
    rows = lessons.table[list(tree.names)].to_numpy()[which]
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
    return _shifted(lessons, bent, which)


def _robust(table: FloatArray, values: FloatArray, expected: FloatArray, strength: FloatArray) -> FloatArray:
    """Return the slopes (k,) that, with a shift, fit `values` (n,) with the least absolute errors.

    `strength` (k,) is how many records the expected slopes count for. The fit is reweighted, so that single
    chains that went wrong do not count.
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


def _shifted(lessons: Lessons, tree: ModelTree, which: IntArray) -> ModelTree:
    return scaled(tree, 1.0, float(np.median(lessons.values[which] - lessons.predicted(tree, which))))


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
