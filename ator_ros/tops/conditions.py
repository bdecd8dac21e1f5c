"""Conditions as data, over named state variables (paper, sections 2.1 and 4.1).

Terms bind variables to values; regions and relations between places bound them without binding
them.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.bases.description import Robot
from ator_ros.geometry import wrap_angle, wrap_angles
from ator_ros.schema import Within, require
from ator_ros.world.readers import RESERVED
from ator_ros.world.state import RobotState, World

# State variables


State = Mapping[str, float]
_OBJECT_VARIABLES = ("x", "y", "vx", "vy")


def state_variables(objects: Iterable[str], *, holder: bool = True) -> tuple[str, ...]:
    """Return the names of the state variables, with those of `objects`, and of a holder.

    See `state_of`.
    """
    robot = [f"robot.{name}" for name in ("x", "y", "yaw", "vx", "vy", "w")]
    hold = ["hold.x", "hold.y"] if holder else []
    moving = [f"{name}.{axis}" for name in objects for axis in _OBJECT_VARIABLES]
    return (*robot, *hold, *moving)


def state_of(world: World, robot: Robot) -> dict[str, float]:
    """Return the state variables of a world.

    Returns
    -------
    dict
        robot.x, robot.y (m), robot.yaw (rad), robot.vx, robot.vy (m/s, forward and to the left),
        robot.w (rad/s); hold.x, hold.y (m), where a robot with a holder would hold an object; of
        each known object, with its name before the dot, x, y (m), vx, vy (m/s).
    """
    moving = world.robot
    pose = moving.pose
    state = {
        "robot.x": pose.x,
        "robot.y": pose.y,
        "robot.yaw": pose.yaw,
        "robot.vx": moving.vx,
        "robot.vy": moving.vy,
        "robot.w": moving.w,
    }
    if robot.holder is not None:
        hold = robot.hold_point(pose)
        state["hold.x"] = hold.x
        state["hold.y"] = hold.y
    for name, there in world.objects.items():
        for axis in _OBJECT_VARIABLES:
            state[f"{name}.{axis}"] = getattr(there, axis)
    return state


def arrived(
    world: World,
    goal: Goal,
    robot: Robot,
) -> World:
    """Return the world when the robot has arrived at `goal` and nothing else has changed."""
    return dataclasses.replace(world, robot=RobotState(goal.robot_pose(robot), goal.speed))


# Clauses


Values = Mapping[str, Any]
"""Variables by name, each a number or an array of shape (n,)."""


class Clause(ABC):
    """A clause of a condition: a statement on a variable, or a relation between places."""

    __slots__ = ()

    @abstractmethod
    def clearance(
        self,
        state: Values,
        goal: Values,
    ) -> Any:
        """Return the margin by which this holds, negative if it does not.

        None if a variable is unknown. It is in m for places, else in the variable's unit; an array
        of shape (n,) if a variable is one.
        """

    def excess(
        self,
        state: State,
        goal: State,
    ) -> float:
        """Return by how much this is violated, 0 if it holds; infinite if a variable is unknown."""
        clearance = self.clearance(state, goal)
        return math.inf if clearance is None else max(0.0, -float(clearance))

    def violation(
        self,
        state: State,
        goal: State,
    ) -> str | None:
        """Return why this does not hold, as text; None if it holds."""
        excess = self.excess(state, goal)
        if excess == 0.0:
            return None
        found = f"it is {excess:.3g} beyond" if excess < math.inf else "but one of them is unknown"
        return f"expected {self}, {found}"


# Relations between places


@dataclass(frozen=True, slots=True)
class Relation(Clause):
    """A clause on the position of one place relative to another.

    Attributes
    ----------
    place, origin : str
        "robot", "hold", "goal", or the name of an object.
    """

    place: str
    origin: str

    @property
    def places(self) -> tuple[str, str]:
        """Both places."""
        return self.place, self.origin

    def clearance(
        self,
        state: Values,
        goal: Values,
    ) -> Any:
        """Return how far in m the place may move until this is violated; see `Clause.clearance`."""
        ends: list[Any] = [
            goal.get(axis) if name == "goal" else state.get(f"{name}.{axis}")
            for name in self.places
            for axis in "xy"
        ]
        if any(value is None for value in ends):
            return None
        x, y, start_x, start_y = ends
        return self.room(x - start_x, y - start_y, start_x)

    @abstractmethod
    def room(
        self,
        dx: Any,
        dy: Any,
        x: Any,
    ) -> Any:
        """Return the clearance of a place (dx, dy) m from an origin at `x` (m)."""


@dataclass(frozen=True, slots=True)
class Distance(Relation):
    """The distance between two places lies in a range, `low` to `high`, in m.

    0 <= `low` <= `high`.
    """

    low: float = 0.0
    high: float = math.inf

    def __post_init__(self) -> None:
        where = f"distance from {self.place} to {self.origin}"
        ascending = 0.0 <= self.low <= self.high
        require(
            ascending,
            where,
            "0 <= low <= high",
            (self.low, self.high),
        )

    def room(
        self,
        dx: Any,
        dy: Any,
        x: Any,  # noqa: ARG002
    ) -> Any:
        """Return the clearance; see `Relation.room`."""
        distance = np.hypot(dx, dy)
        within = distance - self.low if self.low > 0.0 else np.inf
        return np.minimum(within, self.high - distance)

    def __str__(self) -> str:
        return f"distance from {self.place} to {self.origin} {self.low:g} to {self.high:g} m"


@dataclass(frozen=True, slots=True)
class Bearing(Relation):
    """The direction from one place to another lies within an angle of an axis.

    Attributes
    ----------
    most : float
        Greatest angle in rad between the axis and the direction from the origin to the place, at
        most pi / 2.
    axis : float
        Direction of the axis in rad, for an origin at x >= `center`.
    mirrored : bool
        Whether the axis is mirrored for an origin at x < `center` (m), as those of facing bays are.
    """

    most: float
    axis: float = 0.0
    mirrored: bool = False
    center: float = 0.0

    def __post_init__(self) -> None:
        where = f"bearing of {self.place} from {self.origin}"
        sound = 0.0 < self.most <= math.pi / 2.0
        require(
            sound,
            where,
            "an angle above 0 and at most pi / 2",
            self.most,
        )

    def room(
        self,
        dx: Any,
        dy: Any,
        x: Any,
    ) -> Any:
        """Return the clearance; see `Relation.room`."""
        left_of_center = self.mirrored and np.asarray(x) < self.center
        axis = np.where(left_of_center, math.pi - self.axis, self.axis)
        left = self.most - np.abs(wrap_angles(np.arctan2(dy, dx) - axis))
        # Within a quarter turn of the edge, the nearest point of it is at a right angle.
        return np.hypot(dx, dy) * np.sin(np.clip(left, -math.pi / 2.0, math.pi / 2.0))

    def __str__(self) -> str:
        return (
            f"bearing of {self.place} from {self.origin} within {math.degrees(self.most):g} degrees"
        )


# Statements on variables


@dataclass(frozen=True, slots=True)
class Statement(Clause):
    """A variable lies in a range about a target.

    Attributes
    ----------
    variable : str
        A state variable, such as "hold.x" or "robot.yaw".
    target : str or float
        A goal variable ("goal.x"), a state variable ("robot.x"), or a number.
    """

    variable: str
    target: str | float

    @abstractmethod
    def reach(self, target: float) -> tuple[float, float]:
        """Return the least and the greatest difference of the variable from `target`."""

    @property
    def is_at_target(self) -> bool:
        """Whether this places the variable at its target: the range is finite and contains 0."""
        low, high = self.reach(0.0)
        return -math.inf < low <= 0.0 <= high < math.inf

    @property
    def offset(self) -> float:
        """The least difference from the target at which this holds; outward, if so it counts."""
        low, high = self.reach(math.inf)
        return min(max(0.0, low), high)

    def target_in(
        self,
        state: Values,
        goal: Values,
    ) -> Any:
        """Return the value of the target; None if it is unknown."""
        if not isinstance(self.target, str):
            return self.target
        name = self.target.removeprefix("goal.")
        return state.get(name) if name == self.target else goal.get(name)

    def clearance(
        self,
        state: Values,
        goal: Values,
    ) -> Any:
        """Return how far the variable may move until this is violated; see `Clause.clearance`."""
        value = state.get(self.variable)
        target = self.target_in(state, goal)
        if value is None or target is None:
            return None
        difference = value - target
        if self.variable.endswith("yaw"):
            difference = wrap_angle(difference)
        low, high = self.reach(target)
        return np.minimum(difference - low, high - difference)


@dataclass(frozen=True, slots=True)
class Term(Statement):
    """A variable is near a target: up to `tolerance`, in the variable's unit, from it."""

    tolerance: Annotated[float, Within(0.0)]

    def reach(self, target: float) -> tuple[float, float]:  # noqa: ARG002
        """Return the least and the greatest difference of the variable from `target`."""
        return -self.tolerance, self.tolerance

    def __str__(self) -> str:
        return f"{self.variable} within {self.tolerance:g} of {self.target}"


@dataclass(frozen=True, slots=True)
class Region(Statement):
    """A variable lies in a given range about a target; `low` <= `high`.

    Attributes
    ----------
    low, high : float
        Least and greatest difference of the variable from the target, in the variable's unit;
        either may be infinite.
    outward : bool
        Whether differences count away from `center`: with a center of 0 a variable of 5 is 1 beyond
        a target of 4, and one of -5 is 1 beyond a target of -4.
    """

    low: float = -math.inf
    high: float = math.inf
    outward: bool = False
    center: float = 0.0

    def __post_init__(self) -> None:
        where = f"range of {self.variable}"
        require(
            self.low <= self.high,
            where,
            "low <= high",
            (self.low, self.high),
        )

    @property
    def bounds(self) -> bool:
        """Whether it bounds the variable about a number, and relates it to no other variable."""
        return not isinstance(self.target, str)

    def reach(self, target: float) -> tuple[float, float]:
        """Return the least and the greatest difference of the variable from `target`."""
        downward = self.outward and target < self.center
        return (-self.high, -self.low) if downward else (self.low, self.high)

    def __str__(self) -> str:
        beyond = " outward" if self.outward else ""
        return f"{self.variable} {self.low:g} to {self.high:g}{beyond} of {self.target}"


# Conditions


@dataclass(frozen=True, slots=True)
class Condition:
    """A region of the state space: all terms and relations hold."""

    terms: tuple[Statement, ...] = ()
    relations: tuple[Relation, ...] = ()
    _things: frozenset[str] = field(init=False, repr=False, compare=False)
    _objects: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        names = (
            name
            for term in self.terms
            for name in (term.variable, term.target)
            if isinstance(name, str)
        )
        places = (place for relation in self.relations for place in relation.places)
        things = frozenset((*(name.partition(".")[0] for name in names), *places))
        object.__setattr__(self, "_things", things)  # once, as searches project many worlds
        object.__setattr__(self, "_objects", things.difference(RESERVED))

    def goal_names(self) -> frozenset[str]:
        """Return the goal variables, also declared ones, that this condition names as targets."""
        targets = (term.target for term in self.terms if isinstance(term.target, str))
        return frozenset(
            target.removeprefix("goal.") for target in targets if target.startswith("goal.")
        )

    def things(self) -> frozenset[str]:
        """Return the names before the dots of its variables: objects, robot, hold and goal."""
        return self._things

    def objects(self) -> frozenset[str]:
        """Return the names of the objects whose variables this condition names."""
        return self._objects

    def violations(
        self,
        state: State,
        goal: State,
    ) -> list[str]:
        """Return why the condition does not hold, a text for each violated clause.

        Empty if it holds.
        """
        clauses = (*self.terms, *self.relations)
        return [
            reason for clause in clauses if (reason := clause.violation(state, goal)) is not None
        ]

    def shortfall(
        self,
        state: State,
        goal: State,
    ) -> float:
        """Return the greatest excess over all clauses, 0 if all hold.

        Infinite if a variable is unknown.
        """
        return max(
            (clause.excess(state, goal) for clause in (*self.terms, *self.relations)), default=0.0
        )

    def apply(
        self,
        state: Values,
        goal: Values,
    ) -> dict[str, Any]:
        """Return the state with each variable at its target, or as near as its range allows."""
        result = dict(state)
        for term in self.terms:
            target = term.target_in(state, goal)
            if target is None:
                continue
            offset = term.offset
            if isinstance(term, Region) and term.outward:
                offset *= np.copysign(1.0, target - term.center)
            result[term.variable] = target + offset if offset else target
        return result
