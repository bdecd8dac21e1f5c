"""A model tree as nested dataclasses, which JSON files hold, and back, with every number exact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.schema import AtMost, Within, require

_NonNegative = Annotated[float, Within(0.0)]


@dataclass(frozen=True)
class StoredLeaf:
    """A leaf.

    Attributes
    ----------
    samples : float
        Training examples.
    intercept : float
        Of its linear model.
    slopes : dict
        By feature, zeros left out.
    range : tuple of float or None
        Least and greatest prediction; None: no bound.
    spread : float
        Standard deviation of the residuals.
    """

    samples: _NonNegative
    intercept: float
    slopes: dict[str, float]
    range: tuple[float | None, ...]
    spread: _NonNegative

    def __post_init__(self) -> None:
        """Check the range."""
        require(len(self.range) == 2, "range", "two numbers or nulls", list(self.range))
        low, high = self.bounds()
        require(low <= high, "range", "the lower bound first", list(self.range))

    def bounds(self) -> tuple[float, float]:
        """Return the least and the greatest prediction; infinite where there is no bound."""
        low, high = self.range
        return -math.inf if low is None else low, math.inf if high is None else high


@dataclass(frozen=True)
class StoredSplit:
    """A node that tests a feature; `at_most` and `above` are the nodes for its two outcomes."""

    samples: _NonNegative
    feature: str
    threshold: float
    at_most: StoredSplit | StoredLeaf
    above: StoredSplit | StoredLeaf


@dataclass(frozen=True)
class StoredTree:
    """A tree: the names of its features in column order, and its root."""

    features: Annotated[tuple[str, ...], AtMost(200)]  # seven times those there are
    root: StoredSplit | StoredLeaf

    def __post_init__(self) -> None:
        """Check the names."""
        once = len(set(self.features)) == len(self.features) > 0
        require(once, "features", "names, each once", list(self.features))


def stored(tree: ModelTree) -> StoredTree:
    """Return the tree as dataclasses; `restored` makes the same tree of them."""
    nodes: list[StoredSplit | StoredLeaf] = []
    last = len(tree.feature) - 1
    # From the last node to the first, the nodes below are there before the node itself.
    for number in reversed(range(len(tree.feature))):
        samples = float(tree.samples[number])
        if tree.is_leaf[number]:
            slopes = zip(tree.names, tree.coefficients[number], strict=True)
            bounds = (float(tree.lower[number]), float(tree.upper[number]))
            nodes.append(
                StoredLeaf(
                    samples,
                    float(tree.intercept[number]),
                    {name: float(slope) for name, slope in slopes if slope},
                    tuple(bound if math.isfinite(bound) else None for bound in bounds),
                    float(tree.spread[number]),
                )
            )
        else:
            at_most, above = (nodes[last - int(child)] for child in tree.children[number])
            name, threshold = tree.names[tree.feature[number]], float(tree.threshold[number])
            nodes.append(StoredSplit(samples, name, threshold, at_most, above))
    return StoredTree(tree.names, nodes[-1])


def restored(tree: StoredTree) -> ModelTree:
    """Return the tree that was stored; it predicts the same to the last bit.

    Raises
    ------
    ValueError
        A node names a feature that the tree lacks.
    """
    columns = {name: column for column, name in enumerate(tree.features)}

    def column_of(name: str) -> int:
        require(name in columns, "root", f"the features {', '.join(columns)}", name)
        return columns[name]

    rows: list[tuple[float, ...]] = []
    coefficients: list[list[float]] = []
    children: list[list[int]] = []
    waiting: list[tuple[StoredSplit | StoredLeaf, int, int]] = [(tree.root, -1, 0)]
    while waiting:
        node, parent, side = waiting.pop()
        number, slopes = len(rows), [0.0] * len(columns)
        if parent >= 0:
            children[parent][side] = number
        children.append([number, number])
        if isinstance(node, StoredSplit):
            rows.append((column_of(node.feature), node.threshold, 0.0, 0.0, 0.0, 0.0, node.samples))
            waiting += [(node.above, number, 1), (node.at_most, number, 0)]
        else:
            for name, slope in node.slopes.items():
                slopes[column_of(name)] = slope
            rows.append((0, 0.0, node.intercept, *node.bounds(), node.spread, node.samples))
        coefficients.append(slopes)
    feature, threshold, intercept, lower, upper, spread, samples = np.array(rows).T.copy()
    return ModelTree(
        names=tree.features,
        feature=feature.astype(np.intp),
        threshold=threshold,
        children=np.array(children, dtype=np.intp),
        intercept=intercept,
        coefficients=np.array(coefficients),
        lower=lower,
        upper=upper,
        spread=spread,
        samples=samples,
    )
