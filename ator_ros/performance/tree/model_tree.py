"""The model tree learner, an M5'-style regressor for scikit-learn (paper, section 3)."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from ator_ros.geometry import BoolArray, FloatArray, IntArray
from ator_ros.performance.tree.linear_models import (
    TERM_COST,
    Standardized,
    corrected_error,
    fit_node_models,
    squared_error,
)
from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.performance.tree.partition import GrownNode, Partition

_TRACE = 0.01  # deviation of a term, as a share of the model's error, below which it is a trace


try:
    from sklearn.utils.validation import validate_data
except ImportError:  # scikit-learn before 1.6

    def validate_data(estimator: Any, /, *args: Any, **kwargs: Any) -> Any:
        """Validate as scikit-learn 1.6 does, with the method that it replaced."""
        return estimator._validate_data(*args, **kwargs)


class ModelTreeRegressor(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """A regression tree with a linear model at each leaf.

    Learning follows M5' (Quinlan 1992; Wang and Witten 1997): splits by standard-deviation
    reduction, a linear model at every node with greedy term removal, bottom-up pruning by the
    corrected error RMSE × (n + v) / (n − v), and smoothing. It differs from M5' in one measured
    point: the deviation that a split reduces is that around linear models, not around means (see
    `partition`).

    Nothing is random: the same rows give the same tree.

    Parameters
    ----------
    min_samples_leaf : float, default=25
        Least number of rows at a leaf.
    max_leaves : int, default=500
        Most leaves before pruning; the best splits are made first.
    smoothing : float, default=15.0
        How many samples the model of the node above counts for (M5's k); 0 for none.
    extrapolation : float, default=1.0
        How far a leaf's predictions may leave the range of its targets, as a multiple of that
        range.

    Attributes
    ----------
    tree_ : ModelTree
        The tree; it predicts without scikit-learn.
    n_features_in_ : int
    feature_names_in_ : array of str, shape (n_features,)
        Only if `X` had column names.
    """

    def __init__(
        self,
        *,
        min_samples_leaf: float = 25,
        max_leaves: int = 500,
        smoothing: float = 15.0,
        extrapolation: float = 1.0,
    ) -> None:
        self.min_samples_leaf = min_samples_leaf
        self.max_leaves = max_leaves
        self.smoothing = smoothing
        self.extrapolation = extrapolation

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn the tree from features `X`, shape (n, n_features), and the target `y`, shape (n,).

        Raises ValueError if the shapes differ, or a number is not finite.
        """
        checked = validate_data(
            self,
            X,
            y,
            dtype=np.float64,
            y_numeric=True,
            order="C",
        )
        features, target = (np.asarray(part, dtype=np.float64) for part in checked)
        standard = Standardized.from_rows(features, target)
        nodes = Partition(features, standard.rows, self.min_samples_leaf, self.max_leaves).grow()
        numbered = [f"x{column}" for column in range(features.shape[1])]
        names = getattr(self, "feature_names_in_", numbered)
        self.tree_ = self._finish(
            nodes,
            standard,
            tuple(str(name) for name in names),
        )
        return self

    def predict(self, X: ArrayLike) -> FloatArray:
        """Predict the target of each row of `X`, shape (n, n_features); the result has shape (n,).

        Raises NotFittedError before `fit`, and ValueError for other columns.
        """
        check_is_fitted(self)
        tree: ModelTree = self.tree_
        return tree.predict(
            validate_data(
                self,
                X,
                dtype=np.float64,
                order="C",
                reset=False,
            )
        )

    def _finish(
        self,
        nodes: list[GrownNode],
        standard: Standardized,
        names: tuple[str, ...],
    ) -> ModelTree:
        """Fit the linear models, prune and smooth; return the remaining nodes in preorder."""
        children = [node.children for node in nodes]
        moments = np.stack([node.moments for node in nodes])
        samples = moments[:, 0, 0]
        fitted, error = fit_node_models(moments)
        is_leaf = _pruned(children, samples, error)
        smoothed = _smoothed(children, samples, fitted, self.smoothing)
        models = _without_traces(smoothed, moments)
        terms = TERM_COST * np.count_nonzero(fitted, axis=1).clip(1)
        spread = _spread(models, moments, terms) * standard.scale[-1]
        ranges = np.array([node.target_range for node in nodes])
        ranges = ranges * standard.scale[-1] + standard.mean[-1]
        margin = self.extrapolation * np.ptp(ranges, axis=1)
        lower = ranges[:, 0] - margin
        upper = ranges[:, 1] + margin
        intercept, slopes = standard.to_units(models)
        features = np.array([node.feature for node in nodes])
        thresholds = np.array([node.threshold for node in nodes])
        at, below = _preorder(children, is_leaf)
        leaf = is_leaf[at]

        def at_leaves(values: FloatArray) -> FloatArray:
            return np.where(leaf, values[at], 0.0)

        return ModelTree(
            names=names,
            feature=features[at] * ~leaf,
            threshold=np.where(leaf, 0.0, thresholds[at]),
            children=below,
            intercept=at_leaves(intercept),
            coefficients=np.where(leaf[:, None], slopes[at], 0.0),
            lower=at_leaves(lower),
            upper=at_leaves(upper),
            spread=at_leaves(spread),
            samples=samples[at],
        )


Children = list[tuple[int, int] | None]
"""By node, the numbers of the two nodes below it; they are higher than its own."""


def _pruned(children: Children, samples: FloatArray, error: FloatArray) -> BoolArray:
    """Return which nodes become leaves: their model is expected to err no more than those below."""
    is_leaf = np.ones(len(children), dtype=bool)
    best = error.copy()
    for node, pair in reversed(list(enumerate(children))):
        if pair is not None:
            first, second = pair
            of_children = samples[first] * best[first] + samples[second] * best[second]
            of_subtree = of_children / samples[node]
            is_leaf[node] = error[node] <= of_subtree
            best[node] = min(error[node], of_subtree)
    return is_leaf


def _smoothed(
    children: Children,
    samples: FloatArray,
    models: FloatArray,
    smoothing: float,
) -> FloatArray:
    """Return models that predict as smoothed by those of the nodes above."""
    # M5 smooths a prediction p from the leaf up to the root: p' = (n p + k q) / (n + k), with q
    # predicted by the node above, n the samples and k `smoothing`. All are linear in the features,
    # so mixing the coefficients once, from the root down, predicts the same.
    models = models.copy()
    for node, pair in enumerate(children):
        for child in pair or ():
            share = samples[child] / (samples[child] + smoothing)
            models[child] = share * models[child] + (1 - share) * models[node]
    return models


def _without_traces(models: FloatArray, moments: FloatArray) -> FloatArray:
    """Return models without terms whose deviation over a node's rows is a trace of the error.

    Smoothing adds traces of the terms of all models above. They would clutter the rules and count
    as features that influence performance (paper, section 4.2). The mean of a removed term is added
    to the constant.
    """
    samples = moments[:, 0, 0]
    mean = moments[:, 0, 1:-1] / samples[:, None]
    features = np.arange(1, models.shape[1])
    mean_square = moments[:, features, features] / samples[:, None]
    variance = np.maximum(mean_square - mean**2, 0.0)
    error = np.sqrt(squared_error(models, moments) / samples)
    slopes = models[:, 1:]
    deviation = np.abs(slopes) * np.sqrt(variance)
    is_trace = deviation < _TRACE * error[:, None]
    traces = np.where(is_trace, slopes, 0.0)
    constants = models[:, 0] + (traces * mean).sum(axis=1)
    return np.column_stack([constants, slopes - traces])


def _spread(models: FloatArray, moments: FloatArray, terms: FloatArray) -> FloatArray:
    """Return the standard deviations of residuals, those expected on new rows where known."""
    samples = moments[:, 0, 0]
    squared = squared_error(models, moments)
    corrected = corrected_error(squared, samples, terms)
    plain = np.sqrt(squared / samples)
    return np.where(np.isfinite(corrected), corrected, plain)


def _preorder(
    children: Children,
    is_leaf: BoolArray,
) -> tuple[IntArray, IntArray]:
    """Return the remaining nodes in preorder: old numbers (n,), new numbers of children (n, 2)."""
    at: list[int] = []
    below: list[list[int]] = []

    def add(node: int) -> int:
        number = len(at)
        pair = children[node]
        at.append(node)
        below.append([number, number])
        if pair is not None and not is_leaf[node]:
            below[number] = [add(child) for child in pair]
        return number

    add(0)
    return np.array(at, dtype=np.intp), np.array(below, dtype=np.intp)
