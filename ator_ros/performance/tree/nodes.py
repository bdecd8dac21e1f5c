"""A learned model tree (paper, section 3): flat arrays, compiled predictions, and rules."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Hinge:
    """A term of a rule, ``slope*max(0, feature - above)``; if `above` is 0, ``slope*feature``.

    A feature with an `above` other than 0 is never negative. `slope` is in s per unit of the
    feature, `above` in its unit.
    """

    feature: str
    above: float
    slope: float

    def of(self, values: Any) -> Any:
        """Return the term for values of the feature, elementwise."""
        if self.above:
            values = np.maximum(values - self.above, 0.0)
        return self.slope * values


@dataclass(frozen=True, eq=False)
class ModelTree:
    """A binary tree with a linear model at each leaf.

    Nodes are numbered in preorder: the root is 0 and a node comes before all nodes below it. A leaf
    is its own child, so that walking down from a leaf stays there.

    Attributes
    ----------
    names : tuple of str
        Names of the features, in the order of the columns of `X`.
    feature, threshold : arrays, shape (n_nodes,)
        A row goes to the first child if its feature in this column is at most the threshold, else
        to the second; 0 at leaves.
    children : array of int, shape (n_nodes, 2)
        Numbers of the two nodes below; a leaf's own number, twice.
    intercept, coefficients : arrays of float, shape (n_nodes,) and (n_nodes, n_features)
        A leaf's linear model, in units of target and features; 0 at inner nodes.
    lower, upper : array of float, shape (n_nodes,)
        A leaf's linear model is held between these, since it extrapolates without end.
    spread : array of float, shape (n_nodes,)
        Standard deviation to expect of actual minus predicted at a leaf, in the target's unit.
    samples : array of float, shape (n_nodes,)
        How many rows a node was learned from.
    base : tuple of Hinge
        Terms that are added to each prediction, whatever the leaf.
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
    base: tuple[Hinge, ...] = ()

    @property
    def is_leaf(self) -> BoolArray:
        """Which nodes are leaves, shape (n_nodes,)."""
        numbers = np.arange(len(self.feature))
        return np.asarray(self.children[:, 0] == numbers)

    @property
    def n_leaves(self) -> int:
        """Number of leaves, and so of rules."""
        return int(self.is_leaf.sum())

    def used_features(self) -> tuple[str, ...]:
        """Return the features that predictions depend on (paper, section 4.2)."""
        used = (self.coefficients[self.is_leaf] != 0).any(axis=0)
        used[self.feature[~self.is_leaf]] = True
        used |= np.isin(self.names, [hinge.feature for hinge in self.base])
        return tuple(name for name, is_used in zip(self.names, used, strict=True) if is_used)

    @cached_property
    def constant(self) -> float | None:
        """The value that is predicted everywhere, if it is the same."""
        if len(self.feature) > 1 or self.coefficients.any() or self.base:
            return None
        predicted = np.clip(self.intercept, self.lower, self.upper)
        return float(predicted[0])

    def over(self, names: Sequence[str]) -> ModelTree:
        """Return the same tree over the features `names`, which include all that it uses."""
        feature = np.zeros_like(self.feature)
        coefficients = np.zeros((len(self.feature), len(names)))
        for column, name in enumerate(self.names):
            if name in names:
                new_column = names.index(name)
                feature[self.feature == column] = new_column
                coefficients[:, new_column] = self.coefficients[:, column]
        return dataclasses.replace(
            self,
            names=tuple(names),
            feature=feature,
            coefficients=coefficients,
        )

    def narrowed(self) -> ModelTree:
        """Return the same tree over the features that it uses, so that no others are computed."""
        return self.over(self.used_features() or self.names[:1])

    def apply(self, X: FloatArray) -> IntArray:
        """Return the numbers of the leaves of features `X`, shape (n,).

        `X` has the shape (n, n_features) and finite numbers. Raises ValueError for another number
        of features.
        """
        return self.evaluate(np.ascontiguousarray(X.T))[1]

    def predict(self, X: FloatArray) -> FloatArray:
        """Return the predicted targets of features `X`, in the target's unit, shape (n,).

        `X` has the shape (n, n_features). Raises ValueError for another number of features.
        """
        return self.evaluate(np.ascontiguousarray(X.T))[0]

    def evaluate(self, rows: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the results of `predict` and `apply` at once, each of shape (n,).

        `rows` is the transpose of `X`, shape (n_features, n). Raises ValueError for another number
        of features.
        """
        if rows.ndim != 2 or len(rows) != len(self.names):
            raise ValueError(
                f"expected features of shape (n, {len(self.names)}), got {rows.T.shape}"
            )
        splits = self.feature, self.threshold, self.children
        models = self.intercept, self.coefficients, self.lower, self.upper
        return _evaluate(rows, splits, models, self._base_terms)

    @cached_property
    def _base_terms(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Column, `above` and slope of each term of the base, arrays of shape (terms,)."""
        columns = [self.names.index(hinge.feature) for hinge in self.base]
        above = [hinge.above for hinge in self.base]
        slopes = [hinge.slope for hinge in self.base]
        return (
            np.array(columns, dtype=np.intp),
            np.array(above, dtype=float),
            np.array(slopes, dtype=float),
        )


@compiled
def _evaluate(
    rows: FloatArray,
    splits: tuple[IntArray, FloatArray, IntArray],
    models: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    base: tuple[IntArray, FloatArray, FloatArray],
) -> tuple[FloatArray, IntArray]:
    feature, threshold, children = splits
    intercept, coefficients, lower, upper = models
    columns, above, slope = base
    value = np.empty(rows.shape[1])
    leaf = np.empty(rows.shape[1], dtype=np.intp)
    for at in range(rows.shape[1]):
        node = 0
        while children[node, 0] != node:
            is_above = rows[feature[node], at] > threshold[node]
            node = children[node, 1 if is_above else 0]
        result = intercept[node]
        for column in range(len(rows)):
            result += rows[column, at] * coefficients[node, column]
        result = np.minimum(np.maximum(result, lower[node]), upper[node])
        for term in range(len(columns)):
            x = rows[columns[term], at]
            if above[term] != 0.0:
                x = np.maximum(x - above[term], 0.0)
            result += slope[term] * x
        value[at] = result
        leaf[at] = node
    return value, leaf


Bounds = Mapping[str, tuple[float, float]]
"""Lower and upper bound by feature: lower < value <= upper, infinite where there is no bound.

Features are in the order of the path to a leaf, bounds in the units of the features.
"""


def leaves(tree: ModelTree) -> Iterator[tuple[int, Bounds]]:
    """Yield the leaves of the tree, from left to right, with their bounds."""
    waiting: list[tuple[int, Bounds]] = [(0, {})]
    while waiting:
        node, bounds = waiting.pop()
        if tree.is_leaf[node]:
            yield node, bounds
            continue
        name = tree.names[tree.feature[node]]
        threshold = float(tree.threshold[node])
        lower, upper = bounds.get(name, (-math.inf, math.inf))
        at_most, above = (int(child) for child in tree.children[node])
        bounds_above = (max(lower, threshold), upper)
        bounds_at_most = (lower, min(upper, threshold))
        waiting.append((above, {**bounds, name: bounds_above}))
        waiting.append((at_most, {**bounds, name: bounds_at_most}))


@dataclass(frozen=True)
class RuleWriter:
    """Writes the leaves of a tree as rules; angles are in degrees, as in the paper.

    Attributes
    ----------
    tree : ModelTree
    units : mapping of str to str
        Units of the features; rad becomes degrees.
    target, target_unit : str
        Name and unit of the prediction.
    """

    tree: ModelTree
    units: Mapping[str, str]
    target: str = "time"
    target_unit: str = "s"

    def rule(
        self,
        leaf: int,
        bounds: Bounds,
        *,
        shared: str = "",
    ) -> str:
        """Return the rule of a leaf in one line.

        For example ``if (1.86m < dist <= 2.3m) & (angle_to_dest <= 49.7°) then time = 1.26*dist +
        … [s]``.

        Parameters
        ----------
        leaf : int
            Number of the leaf.
        bounds : Bounds
            Its bounds, see `leaves`.
        shared : str
            Name to print instead of the terms of the base.
        """
        tree = self.tree
        conditions = [self._condition(name, *pair) for name, pair in bounds.items()]
        start = f"if {' & '.join(conditions)} then " if conditions else ""
        certainty = (
            f"(± {tree.spread[leaf]:.3g} {self.target_unit}, {tree.samples[leaf]:g} samples)"
        )
        terms = self._terms(leaf, () if shared else tree.base)
        formula = self._formula(terms, float(tree.intercept[leaf]), shared)
        return f"{start}{self.target} = {formula}  [{self.target_unit}]  {certainty}"

    def rules(self) -> str:
        """Return all rules of the tree, one a line; exactly one holds in any situation.

        If a tree with several leaves has a base with bends, the base is printed once, in a line
        before them.
        """
        base = self.tree.base
        lines = []
        shared = ""
        if self.tree.n_leaves > 1 and any(hinge.above for hinge in base):
            shared = "shared"
            lines.append(f"{shared} = {self._formula(base, 0.0)}  [{self.target_unit}]")
        for leaf, bounds in leaves(self.tree):
            lines.append(self.rule(leaf, bounds, shared=shared))
        return "\n".join(lines)

    def explanation(self, situation: FloatArray) -> str:
        """Return the rule that holds in one situation, with the value of each of its terms.

        `situation` are the features, shape (n_features,), in their units. Terms of the base are
        included.
        """
        tree = self.tree
        values = dict(zip(self.tree.names, situation.tolist(), strict=True))
        predicted = float(tree.predict(situation[None, :])[0])
        leaf = int(tree.apply(situation[None, :])[0])
        intercept = float(tree.intercept[leaf])
        spread = float(tree.spread[leaf])
        lines = [
            self.rule(leaf, dict(leaves(tree))[leaf]),
            f"here {self.target} = {predicted:.3f} ± {spread:.3f} {self.target_unit}:",
            f"  {intercept:+9.3f}  constant",
        ]
        parts = {}
        for hinge in self._terms(leaf, tree.base):
            parts[hinge] = hinge.of(values[hinge.feature])
        for hinge, part in sorted(parts.items(), key=lambda item: -abs(item[1])):
            name = hinge.feature
            which = f"{self._term(hinge)}, " if hinge.above else ""
            lines += [f"  {part:+9.3f}  {which}{name} = {self._value(name, values[name])}"]
        linear = intercept + sum(parts.values())
        base = sum(hinge.of(values[hinge.feature]) for hinge in tree.base)
        lower = base + float(tree.lower[leaf])
        upper = base + float(tree.upper[leaf])
        if not lower <= linear <= upper:
            lines.append(
                f"  held within {lower:.3f} to {upper:.3f}: {linear:.3f} is beyond the experience"
            )
        return "\n".join(lines)

    def _condition(self, name: str, lower: float, upper: float) -> str:
        if lower == -math.inf:
            return f"({name} <= {self._value(name, upper)})"
        if upper == math.inf:
            return f"({name} > {self._value(name, lower)})"
        return f"({self._value(name, lower)} < {name} <= {self._value(name, upper)})"

    def _terms(self, leaf: int, base: Sequence[Hinge]) -> list[Hinge]:
        """Return the terms of a leaf's linear model and of a base."""
        tree = self.tree
        slopes = dict(zip(tree.names, tree.coefficients[leaf].tolist(), strict=True))
        for hinge in base:
            slopes[hinge.feature] += hinge.slope * (hinge.above == 0.0)
        bent = [hinge for hinge in base if hinge.above]
        terms = []
        for name, slope in slopes.items():
            terms += [Hinge(name, 0.0, slope)] if slope else []
            terms += [hinge for hinge in bent if hinge.feature == name]
        return terms

    def _term(self, hinge: Hinge) -> str:
        name = hinge.feature
        return f"max(0, {name} - {self._value(name, hinge.above)})" if hinge.above else name

    def _formula(
        self,
        terms: Sequence[Hinge],
        constant: float,
        text: str = "",
    ) -> str:
        parts = [(each.slope / self._scale(each.feature), f"*{self._term(each)}") for each in terms]
        if constant or not (parts or text):
            parts.append((constant, ""))
        for number, name in parts:
            signs = ("-", " - ") if number < 0 else ("", " + ")
            sign = signs[1] if text else signs[0]
            text += f"{sign}{abs(number):.3g}{name}"
        return text

    def _value(self, name: str, value: float) -> str:
        unit = self.units.get(name, "")
        return f"{value * self._scale(name):.3g}{'°' if unit == 'rad' else unit}"

    def _scale(self, name: str) -> float:
        return math.degrees(1.0) if self.units.get(name) == "rad" else 1.0
