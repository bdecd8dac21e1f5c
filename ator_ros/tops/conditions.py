"""Conditions as data: the values of variables with tolerances or ranges (paper, section 2.1)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ator_ros.geometry import wrap_angle
from ator_ros.tops.relations import Relation, excess_of, violation_of
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

    @property
    def places(self) -> bool:
        """Whether the variable lies at its target."""
        return True

    def excess(self, state: State, goal: Mapping[str, float]) -> float | None:
        """Return how far the variable is beyond the tolerance, 0 within; None if one of them is unknown."""
        difference = _difference(self, state, goal)
        return None if difference is None else max(0.0, abs(difference) - self.tolerance)

    def violation(self, state: State, goal: Mapping[str, float]) -> str | None:
        """Return in words why the term does not hold; None where it holds."""
        difference = _difference(self, state, goal)
        if difference is None:
            return f"expected {self.variable} near {self.target}, but one of them is unknown"
        if abs(difference) <= self.tolerance:
            return None
        return (
            f"expected {self.variable} within {self.tolerance:g} of {self.target}, "
            f"it is {abs(difference):.3g} off"
        )

    def reach(self, target: float) -> tuple[float, float]:  # noqa: ARG002
        """Return the least and the greatest difference of the variable from `target`."""
        return -self.tolerance, self.tolerance

    def offset(self, target: float) -> float:  # noqa: ARG002
        """Return the difference from `target` that the variable has once this holds: none."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Region:
    """One statement of a condition: a variable lies in a range about a target.

    Attributes
    ----------
    variable : str
        A state variable, such as "robot.x".
    target : str or float
        A goal variable ("goal.x"), a state variable ("robot.x"), or a number.
    low, high : float
        Least and greatest difference of the variable from the target, in the variable's unit; either may be
        infinite.
    outward : bool
        Whether differences count away from `centre`: with a centre of 0 a variable of 5 is 1 beyond a target
        of 4, and one of -5 is 1 beyond a target of -4.
    centre : float
        See `outward`; in the variable's unit.

    Raises
    ------
    ValueError
        `low` is not a number less than or equal to `high`.
    """

    variable: str
    target: str | float
    low: float = -math.inf
    high: float = math.inf
    outward: bool = False
    centre: float = 0.0

    def __post_init__(self) -> None:
        """Check the range."""
        if not self.low <= self.high:
            raise ValueError(
                f"range of {self.variable}: expected low <= high, got low {self.low:g} and high {self.high:g}"
            )

    @property
    def places(self) -> bool:
        """Whether the variable lies at its target: the range is finite and contains it."""
        return -math.inf < self.low <= 0.0 <= self.high < math.inf

    @property
    def bounds(self) -> bool:
        """Whether it bounds the variable by numbers, and relates it to nothing else."""
        return not isinstance(self.target, str)

    def excess(self, state: State, goal: Mapping[str, float]) -> float | None:
        """Return how far the variable is out of the range, 0 within; None where one of the two is unknown."""
        difference = self._outward(_difference(self, state, goal), state, goal)
        return None if difference is None else max(0.0, self.low - difference, difference - self.high)

    def violation(self, state: State, goal: Mapping[str, float]) -> str | None:
        """Return in words why the term does not hold; None where it holds."""
        difference = self._outward(_difference(self, state, goal), state, goal)
        if difference is None:
            return f"expected {self.variable} about {self.target}, but one of them is unknown"
        if self.low <= difference <= self.high:
            return None
        beyond = " outward" if self.outward else ""
        return (
            f"expected {self.variable} {self.low:g} to {self.high:g}{beyond} of {self.target}, "
            f"it is {difference:.3g}"
        )

    def reach(self, target: float) -> tuple[float, float]:
        """Return the least and the greatest difference of the variable from `target`."""
        return (-self.high, -self.low) if self.outward and target < self.centre else (self.low, self.high)

    def offset(self, target: float) -> float:
        """Return the difference from `target` that the variable has once this holds: the least possible."""
        least = min(max(0.0, self.low), self.high)
        return math.copysign(1.0, target - self.centre) * least if self.outward else least

    def _outward(self, difference: float | None, state: State, goal: Mapping[str, float]) -> float | None:
        """Return the difference as it counts, by the side of the centre on which the target lies."""
        target = _target(self, state, goal)
        if difference is None or target is None or not self.outward:
            return difference
        return math.copysign(1.0, target - self.centre) * difference


Statement = Term | Region
"""One statement of a condition."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A region of the state space: all terms and relations hold."""

    terms: tuple[Statement, ...] = ()
    relations: tuple[Relation, ...] = ()

    def goal_names(self) -> frozenset[str]:
        """Return the goal variables, also declared ones, that this condition names as targets."""
        targets = (term.target for term in self.terms if isinstance(term.target, str))
        return frozenset(target.removeprefix("goal.") for target in targets if target.startswith("goal."))

    def objects(self) -> frozenset[str]:
        """Return the names of the objects whose variables this condition names."""
        names = (
            name for term in self.terms for name in (term.variable, term.target) if isinstance(name, str)
        )
        places = (place for relation in self.relations for place in relation.places)
        return frozenset((*(name.partition(".")[0] for name in names), *places)) - _NO_OBJECTS

    def about_objects(self) -> Condition:
        """Return the terms and relations that name an object."""
        terms = (term for term in self.terms if Condition((term,)).objects())
        relations = (item for item in self.relations if Condition(relations=(item,)).objects())
        return Condition(tuple(terms), tuple(relations))

    def violations(self, state: State, goal: Mapping[str, float]) -> list[str]:
        """Return in words which terms do not hold; an empty list means that the condition holds."""
        violations = [term.violation(state, goal) for term in self.terms]
        violations += [violation_of(relation, state, goal) for relation in self.relations]
        return [violation for violation in violations if violation is not None]

    def shortfall(self, state: State, goal: Mapping[str, float]) -> float:
        """Return the greatest excess over all terms, 0 if all hold; infinite if a variable is unknown."""
        excesses = [term.excess(state, goal) for term in self.terms]
        excesses += [excess_of(relation, state, goal) for relation in self.relations]
        return max((math.inf if excess is None else excess for excess in excesses), default=0.0)

    def apply(self, state: State, goal: Mapping[str, float]) -> dict[str, float]:
        """Return the state with every variable at its target, or as near to it as its range allows."""
        result = dict(state)
        for term in self.terms:
            target = _target(term, state, goal)
            if target is not None:
                offset = term.offset(target)
                result[term.variable] = target + offset if offset else target
        return result


def _difference(term: Statement, state: State, goal: Mapping[str, float]) -> float | None:
    """Return the variable minus its target, an angle wrapped; None where one of the two is unknown."""
    value, target = state.get(term.variable), _target(term, state, goal)
    if value is None or target is None:
        return None
    difference = value - target
    return wrap_angle(difference) if term.variable.endswith("yaw") else difference


def _target(term: Statement, state: State, goal: Mapping[str, float]) -> float | None:
    return lookup(term.target, state, goal) if isinstance(term.target, str) else term.target


def lookup(name: str, state: State, goal: Mapping[str, float]) -> float | None:
    """Return the value of a goal variable ("goal.x") or state variable ("robot.x"), None if unknown."""
    if name.startswith("goal."):
        return goal.get(name.removeprefix("goal."))
    return state.get(name)
