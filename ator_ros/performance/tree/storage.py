"""A model tree as plain JSON-able values and back, with every number exact."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeVar

import numpy as np

from ator_ros.performance.tree.nodes import ModelTree
from ator_ros.printable import short, short_path
from ator_ros.schema import SchemaError, Within, structured

NonNegative = Annotated[float, Within(0.0)]
_T = TypeVar("_T")

# More would be no tree that anybody reads, and a damaged file shall not fill the memory.
_MAX_NODES = 20_000
_MAX_NAMES = 200  # seven times the features there are


class ModelTreeFormatError(ValueError):
    """A stored model tree is damaged or something else; the message names the field and what was expected."""


def tree_to_dict(tree: ModelTree) -> dict[str, Any]:
    """Return the tree as nested dictionaries, which `json` writes and a person reads.

    Returns
    -------
    dict
        ``features`` (names, in column order) and ``root``. A node has ``samples`` and either ``feature``,
        ``threshold``, ``at_most`` and ``above`` (the nodes for feature values up to and above the threshold),
        or ``intercept``, ``slopes`` (by feature, zeros left out), ``range`` (of predictions; null: no bound)
        and ``spread``. Units are those of the features and the target.
    """
    nodes: list[dict[str, Any]] = []
    # From the last node to the first, the nodes below are there before the node itself.
    for number in reversed(range(len(tree.feature))):
        nodes.append(
            _leaf_to_dict(tree, number) if tree.is_leaf[number] else _split_to_dict(tree, number, nodes)
        )
    return {"features": list(tree.names), "root": nodes[-1]}


def _split_to_dict(tree: ModelTree, number: int, nodes: list[dict[str, Any]]) -> dict[str, Any]:
    at_most, above = (nodes[len(tree.feature) - 1 - int(child)] for child in tree.children[number])
    return {
        "samples": float(tree.samples[number]),
        "feature": tree.names[tree.feature[number]],
        "threshold": float(tree.threshold[number]),
        "at_most": at_most,
        "above": above,
    }


def _leaf_to_dict(tree: ModelTree, number: int) -> dict[str, Any]:
    slopes = {
        name: float(slope) for name, slope in zip(tree.names, tree.coefficients[number], strict=True) if slope
    }
    bounds = (float(tree.lower[number]), float(tree.upper[number]))
    return {
        "samples": float(tree.samples[number]),
        "intercept": float(tree.intercept[number]),
        "slopes": slopes,
        "range": [bound if math.isfinite(bound) else None for bound in bounds],
        "spread": float(tree.spread[number]),
    }


def tree_from_dict(data: object, *, names: Sequence[str] | None = None) -> ModelTree:
    """Return the tree that `tree_to_dict` stored; it predicts the same to the last bit.

    Parameters
    ----------
    data : object
        What `json` read.
    names : sequence of str, optional
        The features that the tree must have, in column order.

    Raises
    ------
    ModelTreeFormatError
        If anything is missing, unknown, of another type or not finite.
    """
    table = _structured(data, _Tree, "tree")
    stored = _names(table.features)
    if names is not None and stored != tuple(names):
        raise ModelTreeFormatError(f"features: expected {', '.join(names)}; got {', '.join(stored)}")
    reader = _Reader(stored)
    waiting: list[tuple[Any, str, int, int]] = [(table.root, "root", -1, 0)]
    while waiting:
        data, where, parent, side = waiting.pop()
        number, node = reader.add(data, where)
        if parent >= 0:
            reader.children[parent][side] = number
        if isinstance(node, _Split):
            waiting += [(node.above, f"{where}.above", number, 1)]
            waiting += [(node.at_most, f"{where}.at_most", number, 0)]
    return reader.tree()


@dataclass(frozen=True)
class _Tree:
    features: Any
    root: Any


@dataclass(frozen=True)
class _Split:
    samples: NonNegative
    feature: str
    threshold: float
    at_most: Any
    above: Any


@dataclass(frozen=True)
class _Leaf:
    samples: NonNegative
    intercept: float
    slopes: dict[str, float]
    range: tuple[float | None, ...]
    spread: NonNegative

    def bounds(self) -> tuple[float, float]:
        """Return the least and the greatest prediction; infinite where there is no bound."""
        if len(self.range) != 2:
            raise ValueError(f": expected two numbers or nulls; got {short(list(self.range))}")
        lower, upper = self.range
        low = -math.inf if lower is None else lower
        if upper is not None and upper < low:
            raise ValueError(f"[1]: expected a finite number of at least {low:g}; got {upper:g}")
        return low, math.inf if upper is None else upper


@dataclass(eq=False)
class _Reader:
    """Collects nodes in preorder, checking each."""

    names: tuple[str, ...]
    rows: list[tuple[float, ...]] = field(default_factory=list)
    slopes: list[list[float]] = field(default_factory=list)
    children: list[list[int]] = field(default_factory=list)

    def add(self, data: object, where: str) -> tuple[int, _Split | _Leaf]:
        """Check a node and append it; `where` is its path, for errors."""
        number = len(self.rows)
        if number == _MAX_NODES:
            raise ModelTreeFormatError(f"{short_path(where)}: expected at most {_MAX_NODES} nodes, got more")
        self.children.append([number, number])
        if isinstance(data, Mapping) and "feature" in data:
            split = _structured(data, _Split, where)
            column = self._column(split.feature, f"{where}.feature")
            self.rows.append((column, split.threshold, 0.0, 0.0, 0.0, 0.0, split.samples))
            self.slopes.append([0.0] * len(self.names))
            return number, split
        leaf = _structured(data, _Leaf, where)
        slopes = [0.0] * len(self.names)
        for name, slope in leaf.slopes.items():
            slopes[self._column(name, f"{where}.slopes")] = slope
        try:
            lower, upper = leaf.bounds()
        except ValueError as error:
            raise ModelTreeFormatError(f"{short_path(where)}.range{error}") from error
        self.rows.append((0, 0.0, leaf.intercept, lower, upper, leaf.spread, leaf.samples))
        self.slopes.append(slopes)
        return number, leaf

    def _column(self, name: str, where: str) -> int:
        if name not in self.names:
            raise ModelTreeFormatError(
                f"{short_path(where)}: expected one of {', '.join(self.names)}; got {short(name)}"
            )
        return self.names.index(name)

    def tree(self) -> ModelTree:
        """Return the tree of the nodes added."""
        feature, threshold, intercept, lower, upper, spread, samples = np.array(self.rows).T.copy()
        return ModelTree(
            names=self.names,
            feature=feature.astype(np.intp),
            threshold=threshold,
            children=np.array(self.children, dtype=np.intp),
            intercept=intercept,
            coefficients=np.array(self.slopes),
            lower=lower,
            upper=upper,
            spread=spread,
            samples=samples,
        )


def _names(value: object) -> tuple[str, ...]:
    if isinstance(value, list) and len(value) > _MAX_NAMES:  # before anything is built of them
        raise ModelTreeFormatError(f"features: expected at most {_MAX_NAMES} names, got {len(value)}")
    names = _structured(value, tuple[str, ...], "features")
    if not names or "" in names:
        raise ModelTreeFormatError(f"features: expected a list of names; got {short(value)}")
    if len(set(names)) != len(names):
        raise ModelTreeFormatError(f"features: expected every name once; got {short(value)}")
    return names


def _structured(data: object, schema: type[_T], where: str) -> _T:
    try:
        return structured(data, schema, where, closed=True)
    except SchemaError as error:
        raise ModelTreeFormatError(str(error)) from error
