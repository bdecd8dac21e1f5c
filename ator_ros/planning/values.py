"""What the variables of the state are after a TOP, as symbols with tolerances.

A symbol is a number, the present value of a state variable ("object.x" where it was before the TOP), or a
place that is chosen later. Two variables with the same symbol have the same value, whatever it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ator_ros.actions.base import Point
from ator_ros.geometry import wrap_angle
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Statement

Symbol = float | str
Binding = Mapping[str, Symbol]
"""The goal variables of a TOP by name: what each is. One that is missing is chosen later."""
AXES = ("x", "y", "yaw")
_ANYWHERE = (-math.inf, math.inf)


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

    def within(self, low: float, high: float) -> Value:
        """Return the value of a variable that lies `low` to `high` about this one."""
        return Value(self.symbol, self.low + low, self.high + high)


Values = Mapping[str, Value]
"""Those variables that a TOP changes, as they are afterwards."""


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
            values[term.variable] = target.within(*reach_about(term, target.symbol))
    return values


def _arrival(top: Top, binding: Binding) -> dict[str, Value]:
    """Return the robot's own variables at the goal; nothing promises how exactly they get there."""
    at, other = ("hold", "robot") if top.point is Point.HOLD else ("robot", "hold")
    goal = {name: binding.get(name, chosen(top.name, name)) for name in (*AXES, "speed")}
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


def chosen(top: str, name: str) -> str:
    """Return the symbol of a goal variable that nothing determines."""
    return f"chosen {name} of {top}"


def is_chosen(symbol: Symbol) -> bool:
    """Return whether a symbol is that of a goal variable that nothing determines."""
    return isinstance(symbol, str) and symbol.startswith("chosen ")


def target_of(term: Statement, values: Values, binding: Binding, top: str) -> Value:
    """Return what a statement relates its variable to, in a state in which `values` have changed."""
    if not isinstance(term.target, str):
        return Value(float(term.target))
    if term.target.startswith("goal."):
        name = term.target.removeprefix("goal.")
        return Value(binding.get(name, chosen(top, name)))
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


def satisfies(term: Statement, values: Values, binding: Binding, top: str, *, surely: bool) -> bool:
    """Return whether a statement holds once a TOP has changed `values`.

    Parameters
    ----------
    surely : bool
        Whether it must hold wherever the tolerances of the TOP's post-condition let the variable end;
        otherwise it must hold where a projection puts the variable.
    """
    value = values.get(term.variable, Value(term.variable))
    target = target_of(term, values, binding, top)
    apart = difference(term.variable, value, target)
    if apart is None:
        return False
    low, high = reach_about(term, target.symbol)
    slack = 1e-9
    if surely:
        return (
            low - slack <= apart + value.low - target.high and apart + value.high - target.low <= high + slack
        )
    nominal = apart + value.nominal - target.nominal
    return low - slack <= nominal <= high + slack
