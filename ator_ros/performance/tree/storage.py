"""A model tree as plain JSON-able values and back, with every number exact."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ator_ros.performance.tree.nodes import ModelTree

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
    table = _fields(data, "tree", {"features", "root"})
    stored = _names(table["features"])
    if names is not None and stored != tuple(names):
        raise ModelTreeFormatError(f"features: expected {', '.join(names)}; got {', '.join(stored)}")
    reader = _Reader(stored)
    waiting: list[tuple[object, str, int, int]] = [(table["root"], "root", -1, 0)]
    while waiting:
        node, where, parent, side = waiting.pop()
        number = reader.add(node, where)
        if parent >= 0:
            reader.children[parent][side] = number
        if isinstance(node, Mapping) and "feature" in node:
            waiting += [(node["above"], f"{where}.above", number, 1)]
            waiting += [(node["at_most"], f"{where}.at_most", number, 0)]
    return reader.tree()


@dataclass(eq=False)
class _Reader:
    """Collects nodes in preorder, checking each."""

    names: tuple[str, ...]
    rows: list[tuple[float, ...]] = field(default_factory=list)
    slopes: list[list[float]] = field(default_factory=list)
    children: list[list[int]] = field(default_factory=list)

    def add(self, node: object, where: str) -> int:
        """Check a node and append it; `where` is its path, for errors."""
        number = len(self.rows)
        if number == _MAX_NODES:
            raise ModelTreeFormatError(f"{_short(where)}: expected at most {_MAX_NODES} nodes, got more")
        self.children.append([number, number])
        if isinstance(node, Mapping) and "feature" in node:
            self._add_split(node, where)
        else:
            self._add_leaf(node, where)
        return number

    def _add_split(self, node: object, where: str) -> None:
        table = _fields(node, where, {"samples", "feature", "threshold", "at_most", "above"})
        column = self._column(table["feature"], f"{where}.feature")
        threshold = _number(table["threshold"], f"{where}.threshold")
        samples = _number(table["samples"], f"{where}.samples", least=0.0)
        self.rows.append((column, threshold, 0.0, 0.0, 0.0, 0.0, samples))
        self.slopes.append([0.0] * len(self.names))

    def _add_leaf(self, node: object, where: str) -> None:
        table = _fields(node, where, {"samples", "intercept", "slopes", "range", "spread"})
        if not isinstance(table["slopes"], Mapping):
            raise _wrong(f"{where}.slopes", "a table of slopes by feature", table["slopes"])
        slopes = [0.0] * len(self.names)
        for name, slope in table["slopes"].items():
            slopes[self._column(name, f"{where}.slopes")] = _number(slope, f"{where}.slopes.{name}")
        bounds = table["range"]
        if not isinstance(bounds, list) or len(bounds) != 2:
            raise _wrong(f"{where}.range", "two numbers or nulls", bounds)
        lower = -math.inf if bounds[0] is None else _number(bounds[0], f"{where}.range[0]")
        upper = math.inf if bounds[1] is None else _number(bounds[1], f"{where}.range[1]", least=lower)
        intercept = _number(table["intercept"], f"{where}.intercept")
        spread = _number(table["spread"], f"{where}.spread", least=0.0)
        samples = _number(table["samples"], f"{where}.samples", least=0.0)
        self.rows.append((0, 0.0, intercept, lower, upper, spread, samples))
        self.slopes.append(slopes)

    def _column(self, name: object, where: str) -> int:
        if not isinstance(name, str) or name not in self.names:
            raise _wrong(where, f"one of {', '.join(self.names)}", name)
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
    if not isinstance(value, list) or not value or not all(isinstance(name, str) and name for name in value):
        raise _wrong("features", "a list of names", value)
    if len(value) > _MAX_NAMES:
        raise ModelTreeFormatError(f"features: expected at most {_MAX_NAMES} names, got {len(value)}")
    if len(set(value)) != len(value):
        raise _wrong("features", "every name once", value)
    return tuple(value)


def _fields(value: object, where: str, expected: set[str]) -> Mapping[str, Any]:
    """Check that a value is a table with exactly these fields."""
    if not isinstance(value, Mapping):
        raise _wrong(where, f"a table with {', '.join(sorted(expected))}", value)
    missing, unknown = expected - set(value), set(value) - expected
    if missing or unknown:
        found = [f"missing {', '.join(sorted(missing))}"] if missing else []
        found += [f"unknown {', '.join(sorted(map(str, unknown)))}"] if unknown else []
        raise ModelTreeFormatError(
            f"{_short(where)}: expected the fields {', '.join(sorted(expected))}; {' and '.join(found)}"
        )
    return value


def _number(value: object, where: str, *, least: float = -math.inf) -> float:
    """Check that a value is a finite number, at least `least`."""
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or value < least:  # type: ignore[arg-type, operator]
        wanted = "a finite number" if least == -math.inf else f"a finite number of at least {least:g}"
        raise _wrong(where, wanted, value)
    return float(value)  # type: ignore[arg-type]


def _wrong(where: str, expected: str, value: object) -> ModelTreeFormatError:
    return ModelTreeFormatError(f"{_short(where)}: expected {expected}; got {_short(repr(value))}")


def _short(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:80]} … {text[-80:]}"
