"""A learned model tree: flat arrays, and compiled loops that predict with them (paper, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled
from ator_ros.geometry import BoolArray, FloatArray

IntArray = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class ModelTree:
    """A binary tree with a linear model at each leaf.

    Nodes are numbered in preorder: the root is 0 and a node comes before all nodes below it. A leaf is its
    own child, so that walking down from a leaf stays there.

    Attributes
    ----------
    names : tuple of str
        Names of the features, in the order of the columns of `X`.
    feature : array of int, shape (n_nodes,)
        Column that a node compares; 0 at leaves, where it does not matter.
    threshold : array of float, shape (n_nodes,)
        A row goes to the first child if its feature is at most this, else to the second; 0 at leaves.
    children : array of int, shape (n_nodes, 2)
        Numbers of the two nodes below; a leaf's own number, twice.
    intercept : array of float, shape (n_nodes,)
        Constant term of a leaf's linear model, in the target's unit; 0 at inner nodes.
    coefficients : array of float, shape (n_nodes, n_features)
        Slopes of a leaf's linear model, in target unit per feature unit; 0 at inner nodes.
    lower, upper : array of float, shape (n_nodes,)
        A leaf's predictions are held between these, since a linear model extrapolates without end; 0 at inner
        nodes.
    spread : array of float, shape (n_nodes,)
        Standard deviation to expect of actual minus predicted at a leaf, in the target's unit; 0 at inner
        nodes.
    samples : array of float, shape (n_nodes,)
        How many independent samples (groups of rows, if there were groups) a node was learned from.
    """

    names: tuple[str, ...]
    feature: IntArray
    threshold: FloatArray
    children: IntArray
    intercept: FloatArray
    coefficients: FloatArray
    lower: FloatArray
    upper: FloatArray
    spread: FloatArray
    samples: FloatArray

    def __post_init__(self) -> None:
        constant = float(np.clip(self.intercept[0], self.lower[0], self.upper[0]))
        object.__setattr__(self, "_constant", None if self.used_features() else constant)

    @property
    def is_leaf(self) -> BoolArray:
        """Which nodes are leaves, shape (n_nodes,)."""
        leaf: BoolArray = self.children[:, 0] == np.arange(len(self.feature))
        return leaf

    @property
    def n_leaves(self) -> int:
        """How many leaves, that is rules, the tree has."""
        return int(self.is_leaf.sum())

    def used_features(self) -> tuple[str, ...]:
        """Return the features that partition the tree or appear in a leaf's model (paper, section 4.2)."""
        used = (self.coefficients[self.is_leaf] != 0).any(axis=0)
        used[self.feature[~self.is_leaf]] = True
        return tuple(name for name, is_used in zip(self.names, used, strict=True) if is_used)

    def apply(self, X: FloatArray) -> IntArray:
        """Return the leaf that each row falls into.

        Parameters
        ----------
        X : array of float, shape (n, n_features)
            Finite features, columns as in `names`.

        Returns
        -------
        array of int, shape (n,)
            Numbers of nodes.
        """
        return self.evaluate(*self._rows_of(X))[1]

    @property
    def constant(self) -> float | None:
        """What is predicted everywhere, in the target's unit; None where that depends on features."""
        return self._constant  # type: ignore[attr-defined,no-any-return]

    def predict(self, X: FloatArray) -> FloatArray:
        """Predict the target of each row, in its unit; shapes as in `apply`."""
        return self.evaluate(*self._rows_of(X))[0]

    def predict_with_spread(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predict the target of each row and the standard deviation to expect of its error, each (n,)."""
        value, leaf = self.evaluate(*self._rows_of(X))
        return value, self.spread.take(leaf)

    def _rows_of(self, X: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return features, shape (n, k), as `evaluate` takes them."""
        if X.ndim != 2 or X.shape[1] != len(self.names):
            names = ", ".join(self.names)
            raise ValueError(f"expected features of shape (n, {len(self.names)}) ({names}), got {X.shape}")
        return np.ascontiguousarray(X.T), np.arange(len(self.names))

    def evaluate(self, rows: FloatArray, places: IntArray) -> tuple[FloatArray, IntArray]:
        """Return the prediction for n situations, and their leaves.

        Parameters
        ----------
        rows : array of float, shape (any, n)
            Finite values, those of a feature in a row.
        places : array of int, shape (n_features,)
            The row of each of `names`.
        """
        value, leaf = np.empty(rows.shape[1]), np.empty(rows.shape[1], dtype=np.intp)
        _evaluate(
            rows,
            places,
            self.feature,
            self.threshold,
            self.children,
            self.intercept,
            self.coefficients,
            self.lower,
            self.upper,
            value,
            leaf,
        )
        return value, leaf


@compiled
def _evaluate(
    rows: FloatArray,
    places: IntArray,
    feature: IntArray,
    threshold: FloatArray,
    children: IntArray,
    intercept: FloatArray,
    coefficients: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    value: FloatArray,
    leaf: IntArray,
) -> None:
    for at in range(rows.shape[1]):
        node = 0
        while children[node, 0] != node:
            node = children[node, 1 if rows[places[feature[node]], at] > threshold[node] else 0]
        result = intercept[node]
        for column in range(len(places)):
            result += rows[places[column], at] * coefficients[node, column]
        value[at] = np.minimum(np.maximum(result, lower[node]), upper[node])
        leaf[at] = node
