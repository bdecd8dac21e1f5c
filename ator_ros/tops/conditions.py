"""Conditions as data: which variables have which values, to which tolerance (paper, section 2.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ator_ros.geometry import wrap_angle
from ator_ros.tops.state import State

_NO_OBJECTS = frozenset({"robot", "hold", "goal"})


@dataclass(frozen=True, slots=True)
class Term:
    """One statement of a condition: a variable is near a target.

    Attributes
    ----------
    variable : str
        A state variable, such as "hold.x" or "robot.yaw".
    target : str or float
        A goal variable ("goal.x"), a state variable ("robot.x"), or a number.
    tolerance : float
        Greatest difference, in the variable's unit.
    """

    variable: str
    target: str | float
    tolerance: float

    def error(self, state: State, goal: Mapping[str, float]) -> float | None:
        """Return how far the variable is from its target; None where one of the two is unknown."""
        value = state.get(self.variable)
        target = lookup(self.target, state, goal) if isinstance(self.target, str) else self.target
        if value is None or target is None:
            return None
        difference = value - target
        return abs(wrap_angle(difference) if self.variable.endswith("yaw") else difference)


@dataclass(frozen=True, slots=True)
class Condition:
    """A region of the state space: all terms hold."""

    terms: tuple[Term, ...] = ()

    def goal_names(self) -> frozenset[str]:
        """Return the goal variables (x, y, yaw, speed) that this condition names as targets."""
        targets = (term.target for term in self.terms if isinstance(term.target, str))
        return frozenset(target.removeprefix("goal.") for target in targets if target.startswith("goal."))

    def objects(self) -> frozenset[str]:
        """Return the names of the objects whose variables this condition names."""
        names = (
            name for term in self.terms for name in (term.variable, term.target) if isinstance(name, str)
        )
        return frozenset(name.partition(".")[0] for name in names) - _NO_OBJECTS

    def violations(self, state: State, goal: Mapping[str, float]) -> list[str]:
        """Return in words which terms do not hold; an empty list means that the condition holds."""
        found = []
        for term in self.terms:
            error = term.error(state, goal)
            if error is None:
                found.append(f"expected {term.variable} near {term.target}, but one of them is unknown")
            elif error > term.tolerance:
                found.append(
                    f"expected {term.variable} within {term.tolerance:g} of {term.target}, "
                    f"it is {error:.3g} off"
                )
        return found

    def apply(self, state: State, goal: Mapping[str, float]) -> dict[str, float]:
        """Return the state with every variable at its target: what the world looks like once this holds."""
        result = dict(state)
        for term in self.terms:
            target = lookup(term.target, state, goal) if isinstance(term.target, str) else term.target
            if target is not None:
                result[term.variable] = target
        return result


def lookup(name: str, state: State, goal: Mapping[str, float]) -> float | None:
    """Return the value of a goal variable ("goal.x") or state variable ("robot.x"), None if unknown."""
    if name.startswith("goal."):
        return goal.get(name.removeprefix("goal."))
    return state.get(name)
