"""Facts: the statements of conditions with the goal of one TOP put in, and whether they hold after a TOP.

A goal variable stands for a symbol: a number, the present value of a state variable ("object.x" where it was
before the TOP), or a place that is chosen later. Two variables with the same symbol have the same value,
whatever it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ator_ros.actions.base import Point
from ator_ros.geometry import wrap_angle
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Relation, State, Statement, Term, violation_of

Symbol = float | str
Binding = Mapping[str, Symbol]
"""The goal variables of a TOP by name: what each is. One that is missing is chosen later."""
AXES = ("x", "y", "yaw")
_ANYWHERE = (-math.inf, math.inf)
_SLACK = 1e-9


@dataclass(frozen=True, slots=True)
class Value:
    """A symbol, and how far the variable may be from it: `low` to `high`, in the variable's unit."""

    symbol: Symbol
    low: float = 0.0
    high: float = 0.0

    @property
    def nominal(self) -> float:
        """The difference from the symbol that a projection assumes: the least possible."""
        return min(max(0.0, self.low), self.high)


def after(top: Top, binding: Binding) -> dict[str, Value]:
    """Return the variables that a TOP changes, with their values once its post-condition holds."""
    values = _arrival(top, binding) if top.arrives else {}
    arrived = frozenset(values)
    for term in top.post.terms:
        if term.variable in arrived:
            symbol = values[term.variable].symbol
            values[term.variable] = Value(symbol, *reach_about(term, symbol))
    for term in top.post.terms:
        if term.variable not in arrived:
            target = target_of(term, values, binding, top.name)
            low, high = reach_about(term, target.symbol)
            values[term.variable] = Value(target.symbol, target.low + low, target.high + high)
    return values


def _arrival(top: Top, binding: Binding) -> dict[str, Value]:
    """Return the robot's own variables at the goal; no condition says how exactly they get there."""
    at, other = ("hold", "robot") if top.point is Point.HOLD else ("robot", "hold")
    goal = {name: binding.get(name, _chosen(top.name, name)) for name in (*AXES, "speed")}
    beside = {axis: f"{goal[axis]} beside, heading {goal['yaw']}" for axis in "xy"}
    return {
        f"{at}.x": Value(goal["x"], *_ANYWHERE),
        f"{at}.y": Value(goal["y"], *_ANYWHERE),
        f"{other}.x": Value(beside["x"], *_ANYWHERE),
        f"{other}.y": Value(beside["y"], *_ANYWHERE),
        "robot.yaw": Value(goal["yaw"], *_ANYWHERE),
        "robot.v": Value(binding.get("speed", 0.0), *_ANYWHERE),
        "robot.w": Value(0.0, *_ANYWHERE),
    }


def _chosen(top: str, name: str) -> str:
    return f"chosen {name} of {top}"


def is_chosen(symbol: Symbol) -> bool:
    """Return whether a symbol is that of a goal variable that nothing determines."""
    return isinstance(symbol, str) and symbol.startswith("chosen ")


def target_of(term: Statement, values: Mapping[str, Value], binding: Binding, top: str) -> Value:
    """Return what a statement relates its variable to, in a state in which `values` have changed."""
    if not isinstance(term.target, str):
        return Value(float(term.target))
    if term.target.startswith("goal."):
        name = term.target.removeprefix("goal.")
        return Value(binding.get(name, _chosen(top, name)))
    return values.get(term.target, Value(term.target))


def reach_about(term: Statement, target: Symbol) -> tuple[float, float]:
    """Return the range of a statement about its target, whose side of the centre may count."""
    return term.reach(math.inf if isinstance(target, str) else target)


def difference(variable: str, value: Value, target: Value) -> float | None:
    """Return by how much two symbols differ, 0 where they are the same; None where that is unknown."""
    if value.symbol == target.symbol:
        return 0.0
    if isinstance(value.symbol, str) or isinstance(target.symbol, str):
        return None
    apart = value.symbol - target.symbol
    return wrap_angle(apart) if variable.endswith("yaw") else apart


def _satisfied(term: Statement, values: Mapping[str, Value], binding: Binding, *, surely: bool) -> bool:
    value, target = values.get(term.variable, Value(term.variable)), target_of(term, values, binding, "")
    apart = difference(term.variable, value, target)
    if apart is None:
        return False
    low, high = reach_about(term, target.symbol)
    if surely:
        least, most = apart + value.low - target.high, apart + value.high - target.low
    else:
        least = most = apart + value.nominal - target.nominal
    return low - _SLACK <= least and most <= high + _SLACK


@dataclass(frozen=True)
class Fact:
    """A statement or relation of a condition.

    Attributes
    ----------
    said : Term, Region, Distance or Bearing
        What holds.
    binding : tuple
        The goal variables that it names, as pairs of name and symbol.
    region : str
        Name of the region of places at which it holds; empty where it is about no place to choose.
    surely : bool
        Whether it must hold wherever the tolerances of a TOP let its variables end, as the goal of a plan
        must; otherwise it must hold where a projection puts them.
    """

    said: Statement | Relation
    binding: tuple[tuple[str, Symbol], ...] = ()
    region: str = ""
    surely: bool = False

    @property
    def _variables(self) -> frozenset[str]:
        if not isinstance(self.said, Statement):
            places = [place for place in self.said.places if place != "goal"]
            return frozenset(f"{name}.{axis}" for name in places for axis in "xy")
        sides = (self.said.variable, self.said.target)
        return frozenset(side for side in sides if isinstance(side, str) and not side.startswith("goal."))

    @property
    def depends(self) -> frozenset[str]:
        """The state variables that decide whether it holds: those of its binding, too."""
        return self._variables | {symbol for _, symbol in self.binding if isinstance(symbol, str)}

    def holds_after(self, values: Mapping[str, Value]) -> bool:
        """Return whether it holds once `values` have changed, as far as the symbols determine it."""
        moved = self._variables & values.keys()
        if self.region and any(
            values[name].symbol == f"{self.region}.{name.partition('.')[2]}" for name in moved
        ):
            return True
        if isinstance(self.said, Statement):
            return _satisfied(self.said, values, dict(self.binding), surely=self.surely)
        numbers = {
            name: value.symbol + value.nominal
            for name, value in values.items()
            if isinstance(value.symbol, float)
        }
        goal = {name: symbol for name, symbol in self.binding if isinstance(symbol, float)}
        clearance = self.said.clearance(numbers, goal)
        return clearance is not None and bool(clearance >= -_SLACK)

    def violation(self, state: State) -> str | None:
        """Return in words why it does not hold in a state; None where it does."""
        goal = resolved(dict(self.binding), state)
        if isinstance(self.said, Statement):
            return self.said.violation(state, goal)
        return violation_of(self.said, state, goal)

    def __str__(self) -> str:
        """Return it in words, with numbers for the goal variables that are known."""
        said = self.said
        if not isinstance(said, Statement):
            return str(said)
        target = said.target
        if isinstance(target, str) and target.startswith("goal."):
            symbol = dict(self.binding).get(target.removeprefix("goal."), target)
            target = target if is_chosen(symbol) else symbol
        about = target if isinstance(target, str) else f"{target:g}"
        if isinstance(said, Term):
            return f"{said.variable} within {said.tolerance:g} of {about}"
        outward = " outward" if said.outward else ""
        return f"{said.variable} {said.low:g} to {said.high:g}{outward} of {about}"


def resolved(binding: Binding, state: State) -> dict[str, float]:
    """Return the goal variables whose values are numbers in `state`."""
    found = {
        name: state.get(symbol) if isinstance(symbol, str) else symbol for name, symbol in binding.items()
    }
    return {name: value for name, value in found.items() if value is not None}


def region_name(top: Top, binding: Binding, thing: str) -> str:
    """Return the name of the region of places for `thing` from which a TOP with this goal may start."""
    there = ", ".join(f"{name} {symbol}" for name, symbol in sorted(binding.items()) if name in "xy")
    return f"place of {thing} for {top.name} ({there})"


def preconditions(top: Top, binding: Binding) -> list[Fact]:
    """Return the facts that a TOP with this goal needs; without those that hold in every state."""
    said = (*top.pre.terms, *top.pre.relations)
    return [fact for each in said if (fact := _fact(top, each, binding)) is not None]


def _fact(top: Top, said: Statement | Relation, binding: Binding) -> Fact | None:
    """Return a fact; None if it holds in every state, or is about a goal variable that is chosen to suit."""
    if isinstance(said, Statement):
        names = Condition((said,)).goal_names()
    else:
        names = frozenset("xy") if "goal" in said.places else frozenset()
    used = tuple((name, binding[name]) for name in sorted(names) if name in binding)
    if len(used) < len(names):
        return None
    if isinstance(said, Statement):
        same = target_of(said, {}, dict(used), "").symbol == said.variable
        if same and _satisfied(said, {}, dict(used), surely=False):
            return None
    thing = placed_thing(said)
    return Fact(said, used, region_name(top, binding, thing) if thing else "")


def placed_thing(said: Statement | Relation) -> str | None:
    """Return what a statement puts into a region about the goal: "robot", "hold", an object, or None."""
    if not isinstance(said, Statement):
        others = [place for place in said.places if place != "goal"]
        return others[0] if len(others) == 1 else None
    thing, _, axis = said.variable.partition(".")
    return thing if axis in ("x", "y") and said.target in ("goal.x", "goal.y") else None
