"""Conditions as data, over named state variables (paper, sections 2.1 and 4.1).

Terms bind variables to values; regions and relations between places bound them without binding them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.geometry import wrap_angle, wrap_angles
from ator_ros.robot.description import Robot
from ator_ros.schema import Within
from ator_ros.world.state import RobotState, World

# State variables


State = Mapping[str, float]


def state_of(world: World, robot: Robot) -> dict[str, float]:
    """Return the state variables of a world.

    Returns
    -------
    dict
        robot.x, robot.y (m), robot.yaw (rad), robot.v (m/s), robot.w (rad/s); hold.x, hold.y (m), where
        a robot with a holder would hold an object; of each known object, with its name before the dot, x,
        y (m), vx, vy (m/s).
    """
    pose = world.robot.pose
    state = {
        "robot.x": pose.x,
        "robot.y": pose.y,
        "robot.yaw": pose.yaw,
        "robot.v": world.robot.v,
        "robot.w": world.robot.w,
    }
    if robot.holder is not None:
        hold = robot.hold_point(pose)
        state |= {"hold.x": hold.x, "hold.y": hold.y}
    for name, there in world.objects.items():
        state |= {f"{name}.{axis}": getattr(there, axis) for axis in ("x", "y", "vx", "vy")}
    return state


def arrived(world: World, goal: Goal, robot: Robot) -> World:
    """Return the world when the robot has arrived at `goal` and nothing else has changed."""
    return dataclasses.replace(world, robot=RobotState(goal.robot_pose(robot), goal.speed, 0.0))


# Relations between places


Values = Mapping[str, Any]
"""Variables by name, each a number or an array of shape (n,)."""


@dataclass(frozen=True, slots=True)
class Distance:
    """The distance between two places lies in a range.

    Attributes
    ----------
    place, other : str
        What has an x and a y: "robot", "hold", "goal", or an object.
    low, high : float
        Least and greatest distance in m.

    Raises
    ------
    ValueError
        `low` is negative or above `high`.
    """

    place: str
    other: str
    low: float = 0.0
    high: float = math.inf

    def __post_init__(self) -> None:
        """Check the range."""
        if not 0.0 <= self.low <= self.high:
            raise ValueError(
                f"distance from {self.place} to {self.other}: expected 0 <= low <= high, "
                f"got low {self.low:g} and high {self.high:g}"
            )

    @property
    def places(self) -> tuple[str, str]:
        """The places that it relates."""
        return self.place, self.other

    def clearance(self, state: Values, goal: Values) -> Any:
        """Return how far in m the place may move until this is violated; negative if it is violated.

        None if a place is unknown. An array of shape (n,) if a variable is one.
        """
        offset = _offset(self.other, self.place, state, goal)
        if offset is None:
            return None
        distance = np.hypot(*offset)
        within = distance - self.low if self.low > 0.0 else np.inf + 0.0 * distance
        return np.minimum(within, self.high - distance)

    def __str__(self) -> str:
        """Return it in words."""
        return f"distance from {self.place} to {self.other} {self.low:g} to {self.high:g} m"


@dataclass(frozen=True, slots=True)
class Bearing:
    """The direction from one place to another lies within an angle of an axis.

    Attributes
    ----------
    place, origin : str
        What has an x and a y: "robot", "hold", "goal", or an object.
    most : float
        Greatest angle in rad between the axis and the direction from the origin to the place, at most pi / 2.
    axis : float
        Direction of the axis in rad, for an origin at x >= `centre`.
    mirrored : bool
        Whether the axis is mirrored for an origin at x < `centre`, as those of facing bays are.
    centre : float
        See `mirrored`; in m.

    Raises
    ------
    ValueError
        `most` is not from 0 to pi / 2.
    """

    place: str
    origin: str
    most: float
    axis: float = 0.0
    mirrored: bool = False
    centre: float = 0.0

    def __post_init__(self) -> None:
        """Check the angle."""
        if not 0.0 < self.most <= math.pi / 2.0:
            raise ValueError(
                f"bearing of {self.place} from {self.origin}: expected an angle above 0 and at most pi / 2, "
                f"got {self.most:g}"
            )

    @property
    def places(self) -> tuple[str, str]:
        """The places that it relates."""
        return self.place, self.origin

    def clearance(self, state: Values, goal: Values) -> Any:
        """Return how far in m the place may move until this is violated, as `Distance.clearance` does."""
        offset = _offset(self.origin, self.place, state, goal)
        if offset is None:
            return None
        x, _ = _position(self.origin, state, goal)
        left_of_centre = self.mirrored and np.asarray(x) < self.centre
        axis = np.where(left_of_centre, math.pi - self.axis, self.axis)
        left = self.most - np.abs(wrap_angles(np.arctan2(offset[1], offset[0]) - axis))
        # Within a quarter turn of the edge, the nearest point of it is at a right angle.
        return np.hypot(*offset) * np.sin(np.clip(left, -math.pi / 2.0, math.pi / 2.0))

    def __str__(self) -> str:
        """Return it in words."""
        return f"bearing of {self.place} from {self.origin} within {math.degrees(self.most):g} degrees"


Relation = Distance | Bearing
"""One statement on two places."""


def violation_of(relation: Relation, state: Values, goal: Values) -> str | None:
    """Return why a relation does not hold; None if it holds."""
    clearance = relation.clearance(state, goal)
    if clearance is None:
        return f"expected {relation}, but one of them is unknown"
    return None if clearance >= 0.0 else f"expected {relation}, it is {-float(clearance):.3g} m beyond"


def excess_of(relation: Relation, state: Values, goal: Values) -> float:
    """Return how far in m the place is outside the region, 0 if inside; infinite if a place is unknown."""
    clearance = relation.clearance(state, goal)
    return math.inf if clearance is None else max(0.0, -float(clearance))


def _offset(origin: str, place: str, state: Values, goal: Values) -> tuple[Any, Any] | None:
    """Return the offset in m from one place to another; None where one of them is unknown."""
    start, end = _position(origin, state, goal), _position(place, state, goal)
    if any(value is None for value in (*start, *end)):
        return None
    return end[0] - start[0], end[1] - start[1]


def _position(place: str, state: Values, goal: Values) -> tuple[Any, Any]:
    if place == "goal":
        return goal.get("x"), goal.get("y")
    return state.get(f"{place}.x"), state.get(f"{place}.y")


# Conditions


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
    tolerance: Annotated[float, Within(0.0)]

    @property
    def places(self) -> bool:
        """Whether the variable lies at its target."""
        return True

    def excess(self, state: State, goal: Mapping[str, float]) -> float | None:
        """Return how far the variable exceeds the tolerance, 0 if it does not; None if a value is unknown."""
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
        """Whether it bounds the variable by numbers alone."""
        return not isinstance(self.target, str)

    def excess(self, state: State, goal: Mapping[str, float]) -> float | None:
        """Return how far the variable is outside the range, 0 if inside; None if a value is unknown."""
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
        """Return the difference, with its sign turned outward if `outward` is set."""
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

    def violations(self, state: State, goal: Mapping[str, float]) -> list[str]:
        """Return why the condition does not hold, a text for each violated term; empty if it holds."""
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
