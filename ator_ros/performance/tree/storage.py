"""Conversion of a model tree to nested dataclasses for JSON files, and back.

Every number is exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ator_ros.performance.tree.nodes import Hinge, ModelTree
from ator_ros.schema import Within, require

_NonNegative = Annotated[float, Within(0.0)]


@dataclass(frozen=True)
class StoredLeaf:
    """A leaf: number of training examples, and a linear model with slopes other than 0 by feature.

    `range` are the least and the greatest prediction, `spread` is the standard deviation of the
    residuals.
    """

    samples: _NonNegative
    intercept: float
    slopes: dict[str, float]
    range: tuple[float, ...]
    spread: _NonNegative

    def __post_init__(self) -> None:
        """Check the range."""
        sound = len(self.range) == 2 and self.range[0] <= self.range[1]
        require(sound, "range", "two numbers, the lower bound first", list(self.range))


@dataclass(frozen=True)
class StoredSplit:
    """A node that tests a feature; `at_most` and `above` are the nodes below for both results."""

    samples: _NonNegative
    feature: str
    threshold: float
    at_most: StoredNode
    above: StoredNode


StoredNode = StoredSplit | StoredLeaf


@dataclass(frozen=True)
class StoredTree:
    """A tree: the names of its features in column order, its root, and the base of `ModelTree`."""

    features: tuple[str, ...]
    root: StoredNode
    base: tuple[Hinge, ...] = ()

    def __post_init__(self) -> None:
        """Check the names."""
        once = len(set(self.features)) == len(self.features) > 0
        require(once, "features", "names, each once", list(self.features))
        others = sorted({hinge.feature for hinge in self.base} - set(self.features))
        require(not others, "base", f"the features {', '.join(self.features)}", others)
        for node in _preorder(self.root):
            used = {node.feature} if isinstance(node, StoredSplit) else node.slopes.keys()
            unknown = sorted(used - set(self.features))
            require(
                not unknown,
                "root",
                f"the features {', '.join(self.features)}",
                unknown,
            )


def _preorder(node: StoredNode) -> Iterator[StoredNode]:
    yield node
    if isinstance(node, StoredSplit):
        yield from _preorder(node.at_most)
        yield from _preorder(node.above)


def stored(tree: ModelTree) -> StoredTree:
    """Return the tree as dataclasses."""
    return StoredTree(tree.names, _stored_node(tree, 0), tree.base)


def _stored_node(tree: ModelTree, number: int) -> StoredNode:
    samples = float(tree.samples[number])
    if not tree.is_leaf[number]:
        at_most, above = (_stored_node(tree, int(child)) for child in tree.children[number])
        name = tree.names[tree.feature[number]]
        threshold = float(tree.threshold[number])
        return StoredSplit(
            samples,
            name,
            threshold,
            at_most,
            above,
        )
    slopes = zip(
        tree.names,
        tree.coefficients[number].tolist(),
        strict=True,
    )
    return StoredLeaf(
        samples,
        float(tree.intercept[number]),
        {name: slope for name, slope in slopes if slope},
        (float(tree.lower[number]), float(tree.upper[number])),
        float(tree.spread[number]),
    )


def restored(tree: StoredTree) -> ModelTree:
    """Return the tree that was stored; its predictions are identical."""
    nodes = list(_preorder(tree.root))
    numbers = {id(node): number for number, node in enumerate(nodes)}
    column = {name: number for number, name in enumerate(tree.features)}
    children = np.repeat(
        np.arange(len(nodes), dtype=np.intp)[:, None],
        2,
        axis=1,
    )
    feature = np.zeros(len(nodes), dtype=np.intp)
    coefficients = np.zeros((len(nodes), len(column)))
    threshold, intercept, lower, upper, spread = np.zeros((5, len(nodes)))
    for number, node in enumerate(nodes):
        if isinstance(node, StoredSplit):
            feature[number] = column[node.feature]
            threshold[number] = node.threshold
            children[number] = numbers[id(node.at_most)], numbers[id(node.above)]
        else:
            intercept[number] = node.intercept
            spread[number] = node.spread
            lower[number], upper[number] = node.range
            for name, slope in node.slopes.items():
                coefficients[number, column[name]] = slope
    return ModelTree(
        names=tree.features,
        feature=feature,
        threshold=threshold,
        children=children,
        intercept=intercept,
        coefficients=coefficients,
        lower=lower,
        upper=upper,
        spread=spread,
        samples=np.array([node.samples for node in nodes]),
        base=tree.base,
    )
