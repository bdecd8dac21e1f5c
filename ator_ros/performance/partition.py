"""Grow the partition of a model tree by standard-deviation reduction (paper, section 3).

M5 chooses the split that leaves the least standard deviation on its two sides, as if each side were predicted
by a constant. Here each side is predicted by what a model tree uses, a line: the standard deviation is
that of the residuals of the node's linear model after a line in the split feature has been fitted on either
side. That finds the kinks of the target rather than its slopes, and leaves half the error for as many leaves.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.performance.linear_models import normal_equations, solve
from ator_ros.performance.tree import BoolArray, IntArray

# Less variance of a standardised feature than this, within a node, carries no line.
_FLAT = 1e-9
# A node whose root-mean-square residual is this fraction of the target's deviation is exact.
_EXACT = 1e-9


@dataclass(frozen=True)
class GrowthLimits:
    """When to stop growing; the words are those of `ModelTreeRegressor`."""

    min_samples_leaf: float
    min_groups_leaf: float
    max_depth: int | None
    max_leaves: int
    candidates: int


@dataclass(eq=False)
class GrownNode:
    """A node while the tree grows.

    Attributes
    ----------
    order : array of int, shape (n_features, n)
        The node's rows, sorted by each feature.
    moments : array of float, shape (n_features + 2, n_features + 2)
        Normal equations of the node's rows.
    samples : float
        Groups among the rows, or their total weight if there are no groups.
    target_range : tuple of float
        Least and greatest standardised target.
    feature, threshold, children : int, float, tuple of int
        The split; no children at a leaf.
    """

    order: IntArray
    depth: int
    moments: FloatArray
    samples: float
    target_range: tuple[float, float]
    feature: int = 0
    threshold: float = 0.0
    children: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class _Split:
    """A split of a node, by position in the order of its feature."""

    feature: int
    position: int
    reduction: float


@dataclass(eq=False)
class Partition:
    """Grows a tree best split first.

    Attributes
    ----------
    X : array of float, shape (n, n_features)
        Features in their own units, from which thresholds are taken.
    rows : array of float, shape (n, n_features + 2)
        Standardised rows: constant, features, target.
    weight : array of float, shape (n,)
        Positive; a row of weight 2 counts as two rows.
    groups : array of int, shape (n,), or None
        Rows of one group are not independent of each other. Consecutive codes from 0.
    limits : GrowthLimits
    nodes : list of GrownNode
        What has grown; a node comes before all nodes below it.
    """

    X: FloatArray
    rows: FloatArray
    weight: FloatArray
    groups: IntArray | None
    limits: GrowthLimits
    nodes: list[GrownNode] = field(default_factory=list)

    def grow(self) -> list[GrownNode]:
        """Split the nodes, those first that gain most, and give all of them."""
        order = np.ascontiguousarray(np.argsort(self.X, axis=0, kind="stable").T)
        self._features = np.ascontiguousarray(self.rows[:, 1:-1].T)
        # Equal values share a code, so that no split falls between them.
        self._codes = np.vstack([np.unique(column, return_inverse=True)[1] for column in self.X.T])
        self._goes_left = np.zeros(len(self.X), dtype=bool)
        queue: list[tuple[float, int, _Split]] = []
        self._add(order, 0, queue)
        leaves = 1
        while queue and leaves < self.limits.max_leaves:
            _, number, split = heapq.heappop(queue)
            self._split(self.nodes[number], split, queue)
            leaves += 1
        return self.nodes

    def _add(self, order: IntArray, depth: int, queue: list[tuple[float, int, _Split]]) -> int:
        """Add a node with its normal equations, queue its best split, give its number."""
        rows = order[0]
        table, weight = self.rows[rows], self.weight[rows]
        target = table[:, -1]
        node = GrownNode(
            order=order,
            depth=depth,
            moments=normal_equations(table, weight),
            samples=float(weight.sum()) if self.groups is None else len(np.unique(self.groups[rows])),
            target_range=(float(target.min()), float(target.max())),
        )
        self.nodes.append(node)
        number = len(self.nodes) - 1
        split = self._best_split(node)
        if split is not None:
            heapq.heappush(queue, (-split.reduction, number, split))
        return number

    def _split(self, node: GrownNode, split: _Split, queue: list[tuple[float, int, _Split]]) -> None:
        along = node.order[split.feature]
        below, above = self.X[along[split.position - 1 : split.position + 1], split.feature]
        middle = below + (above - below) / 2
        node.feature, node.threshold = split.feature, float(middle if middle < above else below)
        self._goes_left[node.order[0]] = False
        self._goes_left[along[: split.position]] = True
        left: BoolArray = self._goes_left[node.order]
        n_features = len(node.order)
        first = self._add(node.order[left].reshape(n_features, -1), node.depth + 1, queue)
        second = self._add(node.order[~left].reshape(n_features, -1), node.depth + 1, queue)
        node.children = (first, second)
        node.order = node.order[:, :0]

    def _best_split(self, node: GrownNode) -> _Split | None:
        """Choose the split with the greatest standard-deviation reduction, None if there is none to make."""
        total = node.moments[0, 0]
        minimum = max(
            self.limits.min_samples_leaf,
            self.limits.min_groups_leaf * (total / node.samples if self.groups is not None else 1.0),
        )
        too_deep = self.limits.max_depth is not None and node.depth >= self.limits.max_depth
        if too_deep or total < 2 * minimum:
            return None
        table = self.rows[node.order[0]]
        residual = np.zeros(len(self.X))
        residual[node.order[0]] = table[:, -1] - table[:, :-1] @ solve(node.moments)
        positions, is_split = self._candidates(node, min(self.limits.candidates, int(total // minimum)))
        left, whole = self._line_sums(node, residual, positions)
        right = whole - left
        is_split &= (left[0] >= minimum) & (right[0] >= minimum)
        if not is_split.any() or whole[5, 0, 0] <= _EXACT**2 * total:
            return None
        before = np.sqrt(total * whole[5, 0, 0])
        after = np.where(is_split, _deviation_of_line(left) + _deviation_of_line(right), np.inf)
        # Rounding errors shall not choose between equal splits: the first wins, in any order of the rows.
        best = np.round(after / before, 6).argmin()
        feature, candidate = np.unravel_index(int(best), after.shape)
        reduction = float(before - after[feature, candidate])
        return _Split(int(feature), int(positions[feature, candidate]), reduction)

    def _candidates(self, node: GrownNode, count: int) -> tuple[IntArray, BoolArray]:
        """Place `count` splits per feature at quantiles: how many rows are to the left, (n_features, count).

        Also gives which of them are splits at all: one side may be empty where many values are equal.
        """
        n_features, n = node.order.shape
        cumulative = np.cumsum(self.weight[node.order], axis=1)
        total = cumulative[0, -1]
        targets = total * np.arange(1, count + 1) / (count + 1)
        # One search for all features: feature j's sorted values lie in the j-th stretch of one rising array.
        stretch = np.arange(n_features)[:, None]
        wanted = (targets + 2 * total * stretch).ravel()
        at = np.searchsorted((cumulative + 2 * total * stretch).ravel(), wanted).reshape(n_features, count)
        at = np.minimum(at - n * stretch, n - 1)
        codes = self._codes[stretch, node.order] + len(self.X) * stretch
        after = np.searchsorted(codes.ravel(), np.take_along_axis(codes, at, axis=1).ravel(), side="right")
        positions = after.reshape(n_features, count) - n * stretch
        return np.minimum(positions, n - 1), positions < n

    def _line_sums(
        self, node: GrownNode, residual: FloatArray, positions: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Sum what a line needs (1, z, z², e, z·e, e²) left of each position and over the node.

        Gives arrays of shapes (6, n_features, n_candidates) and (6, n_features, 1).
        """
        order = node.order
        z = self._features[np.arange(len(order))[:, None], order]
        e, w = residual[order], self.weight[order]
        we, wz = w * e, w * z
        # The stretches between the positions are summed first. One of length 0 would give an element, not 0.
        starts = np.column_stack([np.zeros(len(order), dtype=np.intp), positions])
        is_empty = np.diff(starts, axis=1, append=order.shape[1]) == 0
        flat = (starts + order.shape[1] * np.arange(len(order))[:, None]).ravel()
        terms = (w, wz, wz * z, we, we * z, we * e)
        stretches = np.stack([np.add.reduceat(term.ravel(), flat) for term in terms]).reshape(
            6, *starts.shape
        )
        cumulative = np.where(is_empty, 0.0, stretches).cumsum(axis=2)
        return cumulative[:, :, :-1], cumulative[:, :, -1:]


def _deviation_of_line(sums: FloatArray) -> FloatArray:
    """Give √(weight × squared error) of the least-squares line, from its sums (6, …): weight × deviation."""
    weight = np.maximum(sums[0], 1e-300)
    _, z, zz, e, ze, ee = sums
    variance, covariance = zz - z * z / weight, ze - z * e / weight
    has_slope = variance > _FLAT * weight
    explained = np.where(has_slope, covariance**2 / np.where(has_slope, variance, 1.0), 0.0)
    deviation: FloatArray = np.sqrt(weight * np.maximum(ee - e * e / weight - explained, 0.0))
    return deviation
