"""Grow the partition of a model tree by standard-deviation reduction (paper, section 3).

M5 chooses the split with the least standard deviation on both sides, as if each side were predicted
by a constant. Here each side is predicted as in a model tree, by a linear model of all features,
and its deviation is corrected for the number of its terms. That finds the kinks of the target
rather than its slopes, and trees with as many leaves have half the error.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray, IntArray
from ator_ros.performance.tree.linear_models import corrected_error, residual_squares, solve

_EXACT = 1e-9  # share of the target's deviation up to which the residuals of a node count as 0
_CANDIDATES = 15  # thresholds to try per feature and node, at quantiles
_WORST = 1e6  # deviation, in those of the target, of a side with no more samples than terms


@dataclass(eq=False)
class GrownNode:
    """A node while the tree grows; without children it is a leaf.

    `order` (n_features, n) are its rows, sorted by each feature; `moments` are those of
    `linear_models`; `target_range` is the least and the greatest standardized target.
    """

    order: IntArray
    moments: FloatArray
    target_range: tuple[float, float]
    feature: int = 0
    threshold: float = 0.0
    children: tuple[int, int] | None = None


Split = tuple[float, int, int, int]
"""Negative reduction, number of the node, feature, and position in the node's order.

The reduction is negative so that a heap has the best split first.
"""


@dataclass(eq=False)
class Partition:
    """Grows a tree, best split first; in `nodes`, a node comes before all nodes below it.

    Parameters
    ----------
    X : array of float, shape (n, n_features)
        Features in their own units, for the thresholds.
    rows : array of float, shape (n, n_features + 2)
        Standardized rows: constant, features, target.
    """

    X: FloatArray
    rows: FloatArray
    min_samples_leaf: float
    max_leaves: int
    nodes: list[GrownNode] = field(default_factory=list)

    def grow(self) -> list[GrownNode]:
        """Split the nodes, those with the greatest reduction first, and return all of them."""
        by_column = np.argsort(self.X, axis=0, kind="stable")
        order = np.ascontiguousarray(by_column.T)
        # The sides of splits are fitted to the rows with the residuals of their node as target.
        self._residuals = self.rows.copy()
        self._goes_left = np.zeros(len(self.X), dtype=bool)
        queue: list[Split] = []
        self._add(order, queue)
        leaves = 1
        while queue and leaves < self.max_leaves:
            _, number, feature, position = heapq.heappop(queue)
            self._split(self.nodes[number], feature, position, queue)
            leaves += 1
        return self.nodes

    def _add(self, order: IntArray, queue: list[Split]) -> int:
        """Add a node with its normal equations, queue its best split, and return its number."""
        table = self.rows[order[0]]
        target = table[:, -1]
        target_range = (float(target.min()), float(target.max()))
        node = GrownNode(order, table.T @ table, target_range)
        self.nodes.append(node)
        number = len(self.nodes) - 1
        if (split := self._best_split(node, table)) is not None:
            reduction, feature, position = split
            heapq.heappush(queue, (-reduction, number, feature, position))
        return number

    def _split(
        self,
        node: GrownNode,
        feature: int,
        position: int,
        queue: list[Split],
    ) -> None:
        along = node.order[feature]
        below, above = self.X[along[position - 1 : position + 1], feature]
        middle = below + (above - below) / 2
        node.feature = feature
        node.threshold = float(middle if middle < above else below)
        self._goes_left[node.order[0]] = False
        self._goes_left[along[:position]] = True
        left: BoolArray = self._goes_left.take(node.order)
        n_features = len(node.order)
        below_split = node.order[left].reshape(n_features, -1)
        above_split = node.order[~left].reshape(n_features, -1)
        first = self._add(below_split, queue)
        second = self._add(above_split, queue)
        node.children = (first, second)
        node.order = node.order[:, :0]

    def _best_split(
        self,
        node: GrownNode,
        table: FloatArray,
    ) -> tuple[float, int, int] | None:
        """Return the greatest reduction of the deviation by a split, its feature and position."""
        total = node.moments[0, 0]  # number of rows
        minimum = self.min_samples_leaf
        if total < 2 * minimum:
            return None
        solution = solve(node.moments)
        residual = table[:, -1] - table[:, :-1] @ solution
        squared = float(residual @ residual)
        if squared <= _EXACT**2 * total:
            return None
        self._residuals[node.order[0], -1] = residual
        # Splits at quantiles of each feature, by the rows to the left; none falls between equal
        # values.
        count = min(_CANDIDATES, int(total // minimum))
        n = node.order.shape[1]
        shares = n * np.arange(1, count + 1) / (count + 1)
        quantiles = np.ceil(shares).astype(np.intp) - 1
        ends_by_feature = []
        for column, order in zip(self.X.T, node.order, strict=True):
            values = column[order]
            ends_by_feature.append(np.searchsorted(values, values[quantiles], side="right"))
        ends = np.array(ends_by_feature)
        positions = np.minimum(ends, n - 1)
        is_split = ends < n
        sums = self._moments_left(node, positions)
        left = sums[:, :-1]
        right = (sums[:, -1:] - sums)[:, :-1]
        is_split &= left[..., 0, 0] >= minimum
        is_split &= right[..., 0, 0] >= minimum
        if not is_split.any():
            return None
        before = np.sqrt(total * squared)
        after = np.full(is_split.shape, np.inf)
        # Rows × corrected deviation around the linear models of both sides.
        sides = np.stack([left[is_split], right[is_split]])
        weight = sides[..., 0, 0]
        terms = np.full(weight.shape, len(solution))
        error = corrected_error(residual_squares(sides), weight, terms)
        error = np.where(np.isfinite(error), error, _WORST)
        after[is_split] = (weight * error).sum(axis=0)
        # Rounding errors must not choose between equal splits: the first is chosen, in any order of
        # the rows.
        best = np.round(after / before, 6).argmin()
        feature, candidate = np.unravel_index(int(best), after.shape)
        reduction = float(before - after[feature, candidate])
        return reduction, int(feature), int(positions[feature, candidate])

    def _moments_left(self, node: GrownNode, positions: IntArray) -> FloatArray:
        """Return the normal equations of the rows left of each position, and of all rows."""
        all_rows = np.full(len(positions), node.order.shape[1])
        ends = np.column_stack([positions, all_rows])
        columns = self.rows.shape[1]
        moments = np.zeros((*ends.shape, columns, columns))
        for order, stops, sums in zip(node.order, ends.tolist(), moments, strict=True):
            table = self._residuals.take(order, axis=0)
            begin = 0
            for number, end in enumerate(stops):
                if end > begin:
                    np.matmul(
                        table[begin:end].T,
                        table[begin:end],
                        out=sums[number],
                    )
                    begin = end
        return moments.cumsum(axis=1, out=moments)
