"""The variables of goals: pose and arrival speed, which all goals have, and those that an action declares."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ator_ros.actions.base import Goal
from ator_ros.files import is_name
from ator_ros.printable import printable
from ator_ros.schema import require

GOAL_VARIABLES = ("x", "y", "yaw", "speed")
"""The variables of every goal: destination in m and rad, arrival speed in m/s."""
MOST_GOAL_VARIABLES = 16
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
        require(is_name(self.name), "name", "a name of letters, digits and _", self.name)
        others = f"none of {', '.join(GOAL_VARIABLES)}, which every goal has"
        require(self.name not in GOAL_VARIABLES, "name", others, self.name)
        bounds = (self.low, self.high)
        finite = all(map(math.isfinite, bounds)) and self.low < self.high
        require(finite, f"{self.name}: low, high", "finite numbers, low below high", bounds)
        require(self.steps >= 1, f"{self.name}: steps", "a whole number from 1", self.steps)
        inside = self.rest is None or self.low <= self.rest <= self.high
        require(
            inside, f"{self.name}: rest", f"a number from {self.low:g} to {self.high:g}", self.rest
        )

    @property
    def usual(self) -> float:
        """Default value: `rest`, or the middle of the range."""
        return 0.5 * (self.low + self.high) if self.rest is None else self.rest


def goal_values(goal: Goal) -> dict[str, float]:
    """Return all variables of a goal by name: x, y (m), yaw (rad), speed (m/s), and the declared ones."""
    pose = goal.pose
    return {"x": pose.x, "y": pose.y, "yaw": pose.yaw, "speed": float(goal.speed), **goal.values}


def with_values(goal: Goal, values: Mapping[str, float]) -> Goal:
    """Return `goal` with the goal variables in `values` replaced."""
    plain = {name: float(value) for name, value in values.items()}
    pose = goal.pose._replace(**{name: plain[name] for name in goal.pose._fields if name in plain})
    declared = {name: value for name, value in plain.items() if name not in GOAL_VARIABLES}
    speed, others = plain.get("speed", goal.speed), {**goal.values, **declared}
    return dataclasses.replace(
        goal, pose=pose, speed=speed, values=others if declared else goal.values
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
        wanted, given = (
            printable(", ".join(names)) or "no variable" for names in (known, goal.values)
        )
        return f"expected values of {wanted}, got those of {given}"
    for name, value in goal.values.items():
        low, high = known[name].low, known[name].high
        if not low <= value <= high:
            bounds = f"a number from {low:g} to {high:g} {known[name].unit}".rstrip()
            return f"{name}: expected {bounds}, got {value:g}"
    return None
