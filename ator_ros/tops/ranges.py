"""The ranges of goal variables, which are searched, and to which refinement may change them."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.bases.description import Robot
from ator_ros.geometry import FloatArray

Interval = tuple[float, float]
"""Least and greatest value; of an angle, from the first counter-clockwise to the second."""

_EVEN = 0.5  # share of the points that all parts of a range get evenly, so that none goes without


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
    parts : tuple of Interval
        The parts that are allowed, if not all of it is. Of an angle, a part may go beyond `high`.
    """

    low: float
    high: float
    steps: int
    periodic: bool = False
    rest: float | None = None
    parts: tuple[Interval, ...] = ()

    def __str__(self) -> str:
        return " or ".join(f"{low:g} to {high:g}" for low, high in self.intervals)

    @property
    def intervals(self) -> tuple[Interval, ...]:
        """The parts, or the whole range."""
        return self.parts or ((self.low, self.high),)

    @property
    def span(self) -> Interval:
        """The least and the greatest value of all parts."""
        lows, highs = zip(*self.intervals, strict=True)
        return min(lows), max(highs)

    @property
    def width(self) -> float:
        """The sum of the widths of all parts."""
        return math.fsum(high - low for low, high in self.intervals)

    def contains(self, value: float) -> bool:
        """Return whether `value` is in the range, up to rounding.

        An angle may be any number of turns away.
        """
        if not math.isfinite(value):
            return False
        distance = abs(float(self.nearest(np.array([value]))[0]) - value)
        if self.periodic:
            distance = abs(math.remainder(distance, self.high - self.low))
        slack = 1e-9 * (self.high - self.low) + 1e-15 * max(abs(self.low), abs(self.high))
        return distance <= slack

    def nearest(self, values: FloatArray) -> FloatArray:
        """Return the values of the range that are nearest to `values`, shape (n,)."""
        if self.periodic and not self.parts:
            return values
        low, high = np.array(self.intervals).T
        near = values[:, None]
        if self.periodic:
            period = self.high - self.low
            middle = 0.5 * (low + high)
            near = near - period * np.round((near - middle) / period)
        clipped = np.clip(near, low, high)
        best = np.abs(clipped - near).argmin(axis=1)
        return np.asarray(clipped[np.arange(len(values)), best])

    def spread(self, shares: FloatArray) -> FloatArray:
        """Return the values at shares of the range, shape (n,), from 0 (least) to 1."""
        if not self.parts:
            return np.asarray(self.low + (self.high - self.low) * shares)
        ends = np.cumsum(self._shares())
        edges = np.repeat(np.append(0.0, ends), 2)[1:-1]
        edges[-1] = 1.0
        return np.asarray(np.interp(shares, edges, np.ravel(self.parts)))

    def grid(self, count: int) -> tuple[FloatArray, float]:
        """Return about `count` values with the ends of all parts, and their greatest distance."""
        if not self.parts:
            line = np.linspace(self.low, self.high, count, endpoint=not self.periodic)
            return line, float(line[1] - line[0])
        lines: list[FloatArray] = []
        for (low, high), share in zip(self.parts, self._shares(), strict=True):
            lines.append(np.linspace(low, high, max(2, round(share * count)) if low < high else 1))
        steps = [line[1] - line[0] for line in lines if len(line) > 1]
        return np.concatenate(lines), max(map(float, steps), default=0.0)

    def _shares(self) -> FloatArray:
        """Return the share of the points that each part gets: half evenly, half by its width."""
        widths = np.array([high - low for low, high in self.parts])
        even = np.full(len(widths), 1.0 / len(widths))
        if not widths.any():
            return even
        return np.asarray(_EVEN * even + (1.0 - _EVEN) * widths / widths.sum())

    def within(self, intervals: Iterable[Interval]) -> Range | None:
        """Return the part of the range in any of the `intervals`; None if nothing is."""
        wanted = [self._common(own, other) for own in self.intervals for other in intervals]
        parts = tuple(sorted(set(itertools.chain(*wanted))))
        if not parts:
            return None
        if self.periodic:
            is_whole = any(high - low >= self.high - self.low for low, high in parts)
            changed = dataclasses.replace(self, parts=() if is_whole else parts)
        else:
            low = min(low for low, _ in parts)
            high = max(high for _, high in parts)
            several = parts if len(parts) > 1 else ()
            changed = dataclasses.replace(self, low=low, high=high, parts=several)
        if self.rest is None:
            return changed
        rest = float(changed.nearest(np.array([self.rest]))[0])
        return dataclasses.replace(changed, rest=rest)

    def _common(self, own: Interval, other: Interval) -> list[Interval]:
        """Return what is in both intervals; of angles up to two parts, which begin in the range."""
        if not self.periodic:
            low = max(own[0], other[0])
            high = min(own[1], other[1])
            return [(low, high)] if low <= high else []
        period = self.high - self.low
        if own[1] - own[0] >= period:
            width = min(other[1] - other[0], period)
            low = self._in_first_turn(other[0])
            return [(low, low + width)]
        if other[1] - other[0] >= period:
            return [own]
        first = self._in_first_turn(other[0]) - other[0]
        found = []
        for turns in (-1, 0, 1):
            shift = first + turns * period
            low = max(own[0], other[0] + shift)
            high = min(own[1], other[1] + shift)
            if low <= high:
                low_in_turn = self._in_first_turn(low)
                found.append((low_in_turn, low_in_turn + (high - low)))
        return found

    def _in_first_turn(self, angle: float) -> float:
        if self.low <= angle < self.high:  # without rounding
            return angle
        return (angle - self.low) % (self.high - self.low) + self.low


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
