"""The ranges of goal variables, which are searched, and to which refinement may change them."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.bases.description import Robot


@dataclass(frozen=True, slots=True)
class Range:
    """The values that a goal variable may take.

    Attributes
    ----------
    low, high : float
        Bounds in the variable's unit (m, rad, m/s, or as declared).
    steps : int
        How finely the first grid of the search divides it, relative to other variables.
    periodic : bool
        Whether the bounds are the same value, as with an angle.
    rest : float or None
        The value that an unrefined chain takes; None: the one at which the action alone is fastest.
    """

    low: float
    high: float
    steps: int
    periodic: bool = False
    rest: float | None = None

    def contains(self, value: float) -> bool:
        """Return whether `value` is in the range, up to rounding.

        An angle may have any finite value.
        """
        slack = 1e-9 * (self.high - self.low) + 1e-15 * max(abs(self.low), abs(self.high))
        inside = self.low - slack <= value <= self.high + slack
        return math.isfinite(value) and (self.periodic or inside)


Ranges = Mapping[str, Callable[[Robot, Goal], Range]]
"""Goal variable to its range, given robot and goal; a variable without one is never free."""


def _heading(robot: Robot, goal: Goal) -> Range:  # noqa: ARG001
    return Range(
        -math.pi,
        math.pi,
        36,
        periodic=True,
    )


def arrival_speed(
    robot: Robot,
    goal: Goal,
    *,
    most: float = math.inf,
) -> Range:
    """Return the range of an arrival speed: from rest to the robot's limit, and to `most` m/s."""
    speed = robot.greatest_speed(holding=goal.point is Point.HOLD)
    return Range(
        0.0,
        min(speed, most),
        6,
        rest=0.0,
    )


def _x(robot: Robot, goal: Goal) -> Range:  # noqa: ARG001
    x_min, _, x_max, _ = robot.scene.area.lines
    return Range(x_min, x_max, 16)


def _y(robot: Robot, goal: Goal) -> Range:  # noqa: ARG001
    _, y_min, _, y_max = robot.scene.area.lines
    return Range(y_min, y_max, 10)


USUAL_RANGES: Ranges = MappingProxyType({"x": _x, "y": _y, "yaw": _heading, "speed": arrival_speed})
"""The ranges that the robot and its scene determine; a domain may have others."""


def declared_ranges(variables: Iterable[GoalVariable]) -> Ranges:
    """Return the ranges of goal variables that actions declare: the same for all goals."""
    return {variable.name: functools.partial(_declared, variable) for variable in variables}


def _declared(
    variable: GoalVariable,
    robot: Robot,  # noqa: ARG001
    goal: Goal,  # noqa: ARG001
) -> Range:
    return Range(
        variable.low,
        variable.high,
        variable.steps,
        rest=variable.rest,
    )
