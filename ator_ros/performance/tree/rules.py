"""The rules of a model tree as text, in the paper's form (paper, section 3 and Figure 4)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.performance.tree.nodes import ModelTree


@dataclass(frozen=True)
class Rule:
    """One leaf of a model tree.

    Attributes
    ----------
    leaf : int
        Number of the node.
    bounds : dict of str to (float, float)
        By feature, in the order of the path: the rule holds where lower < value <= upper; infinite where it
        is not bounded.
    intercept : float
    slopes : dict of str to float
        By feature, zeros left out.
    spread, samples : float
        Standard deviation to expect of the error, and independent samples that the rule was learned from.
    """

    leaf: int
    bounds: dict[str, tuple[float, float]]
    intercept: float
    slopes: dict[str, float]
    spread: float
    samples: float


def rules(tree: ModelTree) -> Iterator[Rule]:
    """Yield the rules of the tree, from left to right; exactly one holds in any situation."""
    waiting: list[tuple[int, dict[str, tuple[float, float]]]] = [(0, {})]
    while waiting:
        node, bounds = waiting.pop()
        if tree.is_leaf[node]:
            yield _rule(tree, node, bounds)
            continue
        name, threshold = tree.names[tree.feature[node]], float(tree.threshold[node])
        lower, upper = bounds.get(name, (-math.inf, math.inf))
        at_most, above = (int(child) for child in tree.children[node])
        waiting.append((above, {**bounds, name: (max(lower, threshold), upper)}))
        waiting.append((at_most, {**bounds, name: (lower, min(upper, threshold))}))


def rule_for(tree: ModelTree, situation: FloatArray) -> Rule:
    """Return the rule that holds in one situation, an array of shape (n_features,)."""
    leaf = int(tree.apply(np.asarray(situation, dtype=np.float64)[None, :])[0])
    return next(rule for rule in rules(tree) if rule.leaf == leaf)


def _rule(tree: ModelTree, leaf: int, bounds: dict[str, tuple[float, float]]) -> Rule:
    slopes = zip(tree.names, tree.coefficients[leaf], strict=True)
    return Rule(
        leaf=leaf,
        bounds=bounds,
        intercept=float(tree.intercept[leaf]),
        slopes={name: float(slope) for name, slope in slopes if slope},
        spread=float(tree.spread[leaf]),
        samples=float(tree.samples[leaf]),
    )


@dataclass(frozen=True)
class RuleWriter:
    """Writes rules as text.

    Attributes
    ----------
    units : mapping of str to str
        Unit of each feature; those not named have none. Angles in rad are written in degrees, as the paper
        does.
    target, target_unit : str
        What is predicted.
    digits : int
        Significant digits. The tree itself is not rounded.
    """

    units: Mapping[str, str]
    target: str = "time"
    target_unit: str = "s"
    digits: int = 3

    def rule(self, rule: Rule) -> str:
        """Return ``if (1.86m < dist <= 2.3m) & (angle_to_dest <= 49.7°) then time = 1.26*dist + … [s]``."""
        conditions = " & ".join(self._condition(name, *bounds) for name, bounds in rule.bounds.items())
        start = f"if {conditions} then " if conditions else ""
        return f"{start}{self.target} = {self._formula(rule)}  [{self.target_unit}]  {self._certainty(rule)}"

    def tree(self, tree: ModelTree) -> str:
        """Return all rules of the tree, one a line."""
        return "\n".join(self.rule(rule) for rule in rules(tree))

    def explanation(self, tree: ModelTree, situation: FloatArray) -> str:
        """Return the rule that holds in one situation (n_features,), and what each of its terms adds."""
        situation = np.asarray(situation, dtype=np.float64)
        rule = rule_for(tree, situation)
        values = dict(zip(tree.names, situation.tolist(), strict=True))
        lines = [self.rule(rule), f"here {self.target} = {float(tree.predict(situation[None, :])[0]):.3f}"]
        lines[-1] += f" ± {rule.spread:.3f} {self.target_unit}:"
        lines.append(f"  {rule.intercept:+9.3f}  constant")
        parts = {name: slope * values[name] for name, slope in rule.slopes.items()}
        for name, part in sorted(parts.items(), key=lambda item: -abs(item[1])):
            lines += [f"  {part:+9.3f}  {name} = {self._value(name, values[name])}"]
        linear = rule.intercept + sum(parts.values())
        lower, upper = float(tree.lower[rule.leaf]), float(tree.upper[rule.leaf])
        if not lower <= linear <= upper:
            lines.append(
                f"  held within {lower:.3f} to {upper:.3f}, since the rule saw nothing like {linear:.3f}"
            )
        return "\n".join(lines)

    def _condition(self, name: str, lower: float, upper: float) -> str:
        if lower == -math.inf:
            return f"({name} <= {self._value(name, upper)})"
        if upper == math.inf:
            return f"({name} > {self._value(name, lower)})"
        return f"({self._value(name, lower)} < {name} <= {self._value(name, upper)})"

    def _formula(self, rule: Rule) -> str:
        terms = [(slope / self._scale(name), f"*{name}") for name, slope in rule.slopes.items()]
        terms.append((rule.intercept, ""))
        text = ""
        for number, name in terms:
            sign = ("-" if number < 0 else "") if not text else (" - " if number < 0 else " + ")
            text += f"{sign}{self._digits(abs(number))}{name}"
        return text

    def _certainty(self, rule: Rule) -> str:
        return f"(± {self._digits(rule.spread)} {self.target_unit}, {rule.samples:g} samples)"

    def _value(self, name: str, value: float) -> str:
        unit = "°" if self._is_angle(name) else self.units.get(name, "")
        return f"{self._digits(value * self._scale(name))}{unit}"

    def _is_angle(self, name: str) -> bool:
        return self.units.get(name) == "rad"

    def _scale(self, name: str) -> float:
        return math.degrees(1.0) if self._is_angle(name) else 1.0

    def _digits(self, number: float) -> str:
        return f"{number:.{self.digits}g}"
