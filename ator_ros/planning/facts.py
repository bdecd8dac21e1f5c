"""Facts: clauses of conditions for the goal of a TOP, and whether they hold after a TOP.

A goal variable is bound to a symbol: a number, the present value of a state variable ("object.x"
before the TOP), or a place that is chosen later. Variables with the same symbol have the same
value.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from ator_ros.geometry import wrap_angle
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Relation, State, Statement

Symbol = float | str
"""A number in SI units, or the name of a value that is known later."""
Binding = Mapping[str, Symbol]
"""Symbols of the goal variables of a TOP, by name. A missing one is chosen later."""
AXES = ("x", "y", "yaw")
_SLACK = 1e-9  # m or rad by which rounding may violate a condition


@dataclass(frozen=True, slots=True)
class Value:
    """The value of a variable: `low` to `high` (SI units) above a symbol."""

    symbol: Symbol
    low: float = 0.0
    high: float = 0.0

    @property
    def nominal(self) -> float:
        """The difference from the symbol in projections: the least in the range."""
        return min(max(0.0, self.low), self.high)


def after(top: Top, binding: Binding) -> dict[str, Value]:
    """Return the variables that a TOP changes, with their values after it."""
    values: dict[str, Value] = {}
    goal = {name: binding.get(name, _chosen(top.name, name)) for name in AXES}
    goal["speed"] = binding.get("speed", 0.0)
    for name, by in top.arrival().items() if top.arrives else ():
        known = [goal[each] for each in by] or [0.0]
        symbol = known[0]
        if len(known) > 1:
            symbol = f"{known[0]} beside, heading {known[1]}"
        values[name] = Value(symbol, -math.inf, math.inf)  # unless a condition bounds the error
    arrived = frozenset(values)
    for term in sorted(top.post.terms, key=lambda term: term.variable not in arrived):
        if term.variable in arrived:
            target = Value(values[term.variable].symbol)
        else:
            target = target_of(
                term,
                values,
                binding,
                top.name,
            )
        values[term.variable] = _near(term, target)
    return values


def _near(term: Statement, target: Value) -> Value:
    """Return the values at which a statement about a target holds."""
    about = math.inf if isinstance(target.symbol, str) else target.symbol
    low, high = term.reach(about)
    return Value(target.symbol, target.low + low, target.high + high)


def _chosen(top: str, name: str) -> str:
    return f"chosen {name} of {top}"


def is_chosen(symbol: Symbol) -> bool:
    """Return whether a symbol is that of an unbound goal variable."""
    return isinstance(symbol, str) and symbol.startswith("chosen ")


def target_of(
    term: Statement,
    values: Mapping[str, Value],
    binding: Binding,
    top: str,
) -> Value:
    """Return the target of a statement after `values` have changed.

    A statement may be about the goal variables of the TOP with the name `top`, whose symbols are
    in `binding`.
    """
    if not isinstance(term.target, str):
        return Value(float(term.target))
    if term.target.startswith("goal."):
        name = term.target.removeprefix("goal.")
        return Value(binding.get(name, _chosen(top, name)))
    return values.get(term.target, Value(term.target))


def difference(
    variable: str,
    value: Value,
    target: Value,
) -> float | None:
    """Return the difference of two symbols in SI units; None if it is unknown."""
    if value.symbol == target.symbol:
        return 0.0
    if isinstance(value.symbol, str) or isinstance(target.symbol, str):
        return None
    apart = value.symbol - target.symbol
    return wrap_angle(apart) if variable.endswith("yaw") else apart


def _satisfied(
    term: Statement,
    values: Mapping[str, Value],
    binding: Binding,
    *,
    surely: bool,
) -> bool:
    value = values.get(term.variable, Value(term.variable))
    target = target_of(
        term,
        values,
        binding,
        "",
    )
    apart = difference(term.variable, value, target)
    if apart is None:
        return False
    allowed = _near(term, Value(target.symbol))
    if surely:
        least = apart + value.low - target.high
        most = apart + value.high - target.low
    else:
        least = most = apart + value.nominal - target.nominal
    return allowed.low - _SLACK <= least and most <= allowed.high + _SLACK


@dataclass(frozen=True)
class Fact:
    """A clause of a condition for a goal.

    Attributes
    ----------
    clause : Statement or Relation
    binding : tuple of pairs
        Names and symbols of the goal variables in the clause.
    region : str
        Name of the region of places at which it holds; empty if no place is chosen for it.
    surely : bool
        Whether it must hold within all tolerances of a TOP, as the goal of a plan must, or only for
        projected values.
    """

    clause: Statement | Relation
    binding: tuple[tuple[str, Symbol], ...] = ()
    region: str = ""
    surely: bool = False

    @property
    def _variables(self) -> frozenset[str]:
        if not isinstance(self.clause, Statement):
            places = [place for place in self.clause.places if place != "goal"]
            return frozenset(f"{name}.{axis}" for name in places for axis in "xy")
        sides = (self.clause.variable, self.clause.target)
        names = [side for side in sides if isinstance(side, str)]
        return frozenset(name for name in names if not name.startswith("goal."))

    @property
    def depends(self) -> frozenset[str]:
        """The state variables that determine whether it holds."""
        return self._variables | {symbol for _, symbol in self.binding if isinstance(symbol, str)}

    def holds_after(self, values: Mapping[str, Value]) -> bool:
        """Return whether the symbols determine that it holds after `values` have changed."""
        if self.region and self._moves_into_region(values):
            return True
        if isinstance(self.clause, Statement):
            return _satisfied(
                self.clause,
                values,
                dict(self.binding),
                surely=self.surely,
            )
        numbers = {}
        for name, value in values.items():
            if isinstance(value.symbol, float):
                numbers[name] = value.symbol + value.nominal
        goal = {name: symbol for name, symbol in self.binding if isinstance(symbol, float)}
        clearance = self.clause.clearance(numbers, goal)
        return clearance is not None and bool(clearance >= -_SLACK)

    def _moves_into_region(self, values: Mapping[str, Value]) -> bool:
        for name in self._variables & values.keys():
            axis = name.partition(".")[2]
            if values[name].symbol == f"{self.region}.{axis}":
                return True
        return False

    def violation(self, state: State) -> str | None:
        """Return why it does not hold in a state; None if it holds."""
        return self.clause.violation(state, resolved(dict(self.binding), state))

    def __str__(self) -> str:
        clause = self.clause
        if not isinstance(clause, Statement):
            return str(clause)
        target = clause.target
        if isinstance(target, str) and target.startswith("goal."):
            symbol = dict(self.binding).get(target.removeprefix("goal."), target)
            target = target if is_chosen(symbol) else symbol
        about = target if isinstance(target, str) else f"{target:g}"
        return str(dataclasses.replace(clause, target=about))


def resolved(binding: Binding, state: State) -> dict[str, float]:
    """Return the goal variables whose values are known in `state`, in SI units."""
    values = {}
    for name, symbol in binding.items():
        value = state.get(symbol) if isinstance(symbol, str) else symbol
        if value is not None:
            values[name] = value
    return values


def region_name(
    top: Top,
    binding: Binding,
    thing: str,
) -> str:
    """Return a name for the places of `thing` from which a TOP with this goal may start."""
    coordinates = [(name, symbol) for name, symbol in sorted(binding.items()) if name in "xy"]
    there = ", ".join(f"{name} {symbol}" for name, symbol in coordinates)
    return f"place of {thing} for {top.name} ({there})"


def preconditions(top: Top, binding: Binding) -> list[Fact]:
    """Return the facts that a TOP with this goal needs and that do not always hold.

    Clauses about unbound goal variables are left out.
    """
    facts = []
    clauses: tuple[Statement | Relation, ...] = (*top.pre.terms, *top.pre.relations)
    for clause in clauses:
        if isinstance(clause, Statement):
            names = Condition((clause,)).goal_names()
        else:
            names = frozenset("xy") if "goal" in clause.places else frozenset()
        used = {name: binding[name] for name in sorted(names) if name in binding}
        unbound = len(used) < len(names)
        if not (unbound or _always_holds(clause, used)):
            thing = placed_thing(clause)
            region = region_name(top, binding, thing) if thing else ""
            facts.append(Fact(clause, tuple(used.items()), region))
    return facts


def _always_holds(clause: Statement | Relation, binding: Binding) -> bool:
    """Return whether a clause is about one variable only and holds whatever its value."""
    if not isinstance(clause, Statement):
        return False
    about_itself = (
        target_of(
            clause,
            {},
            binding,
            "",
        ).symbol
        == clause.variable
    )
    return about_itself and _satisfied(
        clause,
        {},
        binding,
        surely=False,
    )


def placed_thing(clause: Statement | Relation) -> str | None:
    """Return what a clause places near the goal: "robot", "hold" or an object; None if nothing."""
    if not isinstance(clause, Statement):
        others = [place for place in clause.places if place != "goal"]
        return others[0] if len(others) == 1 else None
    thing, _, axis = clause.variable.partition(".")
    return thing if axis in ("x", "y") and clause.target in ("goal.x", "goal.y") else None
