"""The variables of goals: pose and arrival speed of all goals, and what an action declares."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.files import is_name
from ator_ros.geometry import Pose
from ator_ros.printable import printable
from ator_ros.schema import require

GOAL_VARIABLES = ("x", "y", "yaw", "speed")
"""The variables of every goal: destination in m and rad, arrival speed in m/s."""
ORDER = "order"
"""No goal variable: opens the place of a call in its chain; see `ator_ros.tops.ordering`."""
STOP = "stop"
"""The goal variable of actions that can pass: 1 if the robot stops at the goal, 0 if it passes.

It need only come within the tolerance of the position then. If a call opens it, refinement decides;
of an action that has an arrival speed instead, that is opened.
"""
MOST_GOAL_VARIABLES = 8
"""Further goal variables that an action may declare."""


@dataclass(frozen=True, slots=True)
class GoalVariable:
    """A variable of an action's goal beyond pose and arrival speed, such as the height of a fork.

    Attributes
    ----------
    name : str
        Its name in calls; conditions name it as goal.NAME, features and experience as NAMEg.
    unit : str
        Its SI unit; empty for a number without one. An angle does not wrap.
    low, high : float
        The values that a goal may have, and that refinement searches.
    steps, rest
        See `ator_ros.tops.ranges.Range`.
    """

    name: str
    unit: str
    low: float
    high: float
    steps: int = 12
    rest: float | None = None

    def __post_init__(self) -> None:
        require(
            is_name(self.name),
            "name",
            "a name of letters, digits and _",
            self.name,
        )
        others = f"none of {', '.join((*GOAL_VARIABLES, ORDER))}, which have a meaning of their own"
        require(
            self.name not in (*GOAL_VARIABLES, ORDER),
            "name",
            others,
            self.name,
        )
        bounds = (self.low, self.high)
        ascending = -math.inf < self.low < self.high < math.inf
        require(
            ascending,
            f"{self.name}: low, high",
            "finite numbers, low below high",
            bounds,
        )
        require(
            self.steps >= 1,
            f"{self.name}: steps",
            "a whole number from 1",
            self.steps,
        )
        inside = self.rest is None or self.low <= self.rest <= self.high
        numbers = f"a number from {self.low:g} to {self.high:g}"
        require(
            inside,
            f"{self.name}: rest",
            numbers,
            self.rest,
        )

    @property
    def usual(self) -> float:
        """Default value: `rest`, or the middle of the range."""
        return 0.5 * (self.low + self.high) if self.rest is None else self.rest


STOPS = GoalVariable(STOP, "", 0.0, 1.0, steps=2, rest=1.0)
"""The goal variable `STOP` as a declaration."""


def passes(goal: Goal) -> bool:
    """Return whether a goal is passed without a stop, see `STOP`."""
    return goal.values.get(STOP) == 0.0


def goals_to_stop(goals: Iterable[Goal]) -> tuple[Goal, ...]:
    """Return the first goals up to the first at which the robot stops."""
    found = []
    for goal in goals:
        found.append(goal)
        if not passes(goal):
            break
    return tuple(found)


def drawn_values(
    declared: Iterable[GoalVariable],
    rng: np.random.Generator,
) -> dict[str, float]:
    """Draw the values of declared goal variables from their ranges; of `STOP` one of both."""
    values = {}
    for item in declared:
        if item.name == STOP:
            values[STOP] = float(rng.integers(2))
        else:
            values[item.name] = float(rng.uniform(item.low, item.high))
    return values


def goal_values(goal: Goal) -> dict[str, float]:
    """Return all variables of a goal by name: x, y (m), yaw (rad), speed (m/s), declared ones."""
    return {**goal.pose._asdict(), "speed": goal.speed, **goal.values}


def with_values(goal: Goal, values: Mapping[str, float]) -> Goal:
    """Return `goal` with the goal variables in `values` replaced."""
    given = {name: float(value) for name, value in values.items()}
    pose = {name: given.pop(name) for name in Pose._fields if name in given}
    speed = given.pop("speed", goal.speed)
    return dataclasses.replace(
        goal,
        pose=goal.pose._replace(**pose),
        speed=speed,
        values={**goal.values, **given},
    )


def direct_name(name: str) -> str:
    """Return the name of a goal variable in features and experience: that of yaw is yawg."""
    return f"{name}g"


def wrong_values(goal: Goal, declared: Iterable[GoalVariable]) -> str | None:
    """Return a message if the values of a goal are not those that its action declares.

    Else None.
    """
    known = {variable.name: variable for variable in declared}
    if set(goal.values) != set(known):
        wanted = printable(", ".join(known)) or "no variable"
        given = printable(", ".join(goal.values)) or "no variable"
        return f"expected values of {wanted}, got those of {given}"
    for name, value in goal.values.items():
        variable = known[name]
        if name == STOP and value not in (0.0, 1.0):
            return f"{name}: expected 0 or 1, got {value:g}"
        if not variable.low <= value <= variable.high:
            bounds = f"a number from {variable.low:g} to {variable.high:g} {variable.unit}".rstrip()
            return f"{name}: expected {bounds}, got {value:g}"
    return None
