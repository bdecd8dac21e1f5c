"""Facts: the statements of conditions with the goal of one TOP put in, each true or false."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ator_ros.planning.values import Binding, Symbol, Value, Values, is_chosen, satisfies, target_of
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Relation, State, Statement, violation_of

_GOAL = "goal"
_SLACK = 1e-9


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
        Whether it must hold with all tolerances, as what the user wants must.
    """

    said: Statement | Relation
    binding: tuple[tuple[str, Symbol], ...] = ()
    region: str = ""
    surely: bool = False

    @property
    def variables(self) -> frozenset[str]:
        """The state variables that it is about."""
        if not isinstance(self.said, Statement):
            names = [place for place in self.said.places if place != _GOAL]
            return frozenset(f"{name}.{axis}" for name in names for axis in "xy")
        sides = (self.said.variable, self.said.target)
        return frozenset(side for side in sides if isinstance(side, str) and not side.startswith("goal."))

    @property
    def depends(self) -> frozenset[str]:
        """The state variables that decide whether it holds: those of its binding, too."""
        return self.variables | {symbol for _, symbol in self.binding if isinstance(symbol, str)}

    def holds_after(self, values: Values) -> bool:
        """Return whether it holds once `values` have changed, as far as the symbols tell."""
        if self.region and any(
            value.symbol == f"{self.region}.{axis}" for axis, value in self._moved(values)
        ):
            return True
        if isinstance(self.said, Statement):
            return satisfies(self.said, values, dict(self.binding), "", surely=self.surely)
        numbers = _numbers(values)
        goal = {name: symbol for name, symbol in self.binding if isinstance(symbol, float)}
        clearance = self.said.clearance(numbers, goal)
        return clearance is not None and bool(clearance >= -_SLACK)

    def _moved(self, values: Values) -> Iterator[tuple[str, Value]]:
        return ((name.partition(".")[2], values[name]) for name in self.variables if name in values)

    def holds_in(self, state: State) -> bool:
        """Return whether it holds in a state."""
        return self.violation(state) is None

    def violation(self, state: State) -> str | None:
        """Return in words why it does not hold in a state; None where it does."""
        goal = resolved(dict(self.binding), state)
        if isinstance(self.said, Statement):
            return self.said.violation(state, goal)
        return violation_of(self.said, state, goal)

    def __str__(self) -> str:
        """Return it in words."""
        return worded(self.said, dict(self.binding))


def _numbers(values: Values) -> dict[str, Any]:
    return {
        name: value.symbol + value.nominal
        for name, value in values.items()
        if isinstance(value.symbol, float)
    }


def resolved(binding: Binding, state: State) -> dict[str, float]:
    """Return the goal variables whose values are numbers in `state`."""
    found = {
        name: state.get(symbol) if isinstance(symbol, str) else symbol for name, symbol in binding.items()
    }
    return {name: value for name, value in found.items() if value is not None}


def worded(said: Statement | Relation, binding: Mapping[str, Symbol]) -> str:
    """Return a statement in words, with numbers for the goal variables that are known."""
    if not isinstance(said, Statement):
        return str(said)
    target = said.target
    if isinstance(target, str) and target.startswith("goal."):
        symbol = binding.get(target.removeprefix("goal."), target)
        target = target if is_chosen(symbol) else symbol
    about = target if isinstance(target, str) else f"{target:g}"
    if hasattr(said, "tolerance"):
        return f"{said.variable} within {said.tolerance:g} of {about}"
    outward = " outward" if said.outward else ""
    return f"{said.variable} {said.low:g} to {said.high:g}{outward} of {about}"


def region_name(top: Top, binding: Binding, thing: str) -> str:
    """Return the name of the region of places for `thing` from which a TOP with this goal may start."""
    there = ", ".join(f"{name} {symbol}" for name, symbol in sorted(binding.items()) if name in "xy")
    return f"place of {thing} for {top.name} ({there})"


def preconditions(top: Top, binding: Binding) -> list[Fact]:
    """Return the facts that a TOP with this goal needs; without those that hold in every state."""
    return [fact for said in _said(top.pre) if not _trivial(fact := _fact(top, said, binding))]


def _said(condition: Condition) -> tuple[Statement | Relation, ...]:
    return (*condition.terms, *condition.relations)


def _fact(top: Top, said: Statement | Relation, binding: Binding) -> Fact:
    names = goal_names(said)
    used = tuple((name, binding[name]) for name in sorted(names) if name in binding)
    thing = placed_thing(said)
    return Fact(said, used, region_name(top, binding, thing) if thing else "")


def goal_names(said: Statement | Relation) -> frozenset[str]:
    """Return the goal variables that a statement or relation names."""
    if not isinstance(said, Statement):
        return frozenset("xy") if _GOAL in said.places else frozenset()
    return Condition((said,)).goal_names()


def placed_thing(said: Statement | Relation) -> str | None:
    """Return what a statement puts into a region about the goal: "robot", "hold", an object, or None."""
    if not isinstance(said, Statement):
        others = [place for place in said.places if place != _GOAL]
        return others[0] if len(others) == 1 else None
    thing, _, axis = said.variable.partition(".")
    return thing if axis in ("x", "y") and said.target in ("goal.x", "goal.y") else None


def _trivial(fact: Fact) -> bool:
    """Return whether a fact holds in every state, or is about a goal variable that is chosen to suit."""
    if len(fact.binding) < len(goal_names(fact.said)):
        return True
    if not isinstance(fact.said, Statement):
        return False
    target = target_of(fact.said, {}, dict(fact.binding), "")
    return target.symbol == fact.said.variable and satisfies(
        fact.said, {}, dict(fact.binding), "", surely=False
    )
