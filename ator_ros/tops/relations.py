"""Relations between places as terms of conditions: regions of the plane, as data.

A relation binds no goal variable: it bounds the places that may be chosen. How far each place lies within it
is known in m, so that a plan can keep the distance by which its execution may miss.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ator_ros.geometry import wrap_angles

Values = Mapping[str, Any]
"""Variables by name, each a number or an array of shape (n,)."""


@dataclass(frozen=True, slots=True)
class Distance:
    """Two places are neither too near to each other nor too far apart.

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
        """Return by how much in m the place may move before this fails, negative where it does.

        None where a place is unknown. A number, or an array of shape (n,) if a variable is one.
        """
        way = _way(self.other, self.place, state, goal)
        if way is None:
            return None
        distance = np.hypot(*way)
        within = distance - self.low if self.low > 0.0 else np.inf + 0.0 * distance
        return np.minimum(within, self.high - distance)

    def __str__(self) -> str:
        """Return it in words."""
        return f"distance from {self.place} to {self.other} {self.low:g} to {self.high:g} m"


@dataclass(frozen=True, slots=True)
class Bearing:
    """A place lies within an angle of an axis that begins at another place.

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
        """Return by how much in m the place may move before this fails, as `Distance.clearance` does."""
        way = _way(self.origin, self.place, state, goal)
        if way is None:
            return None
        x, _ = _position(self.origin, state, goal)
        left_of_centre = self.mirrored and np.asarray(x) < self.centre
        axis = np.where(left_of_centre, math.pi - self.axis, self.axis)
        left = self.most - np.abs(wrap_angles(np.arctan2(way[1], way[0]) - axis))
        # Within a quarter turn of the edge, the nearest point of it is at a right angle.
        return np.hypot(*way) * np.sin(np.clip(left, -math.pi / 2.0, math.pi / 2.0))

    def __str__(self) -> str:
        """Return it in words."""
        return f"bearing of {self.place} from {self.origin} within {math.degrees(self.most):g} degrees"


Relation = Distance | Bearing
"""One statement on two places."""


def violation_of(relation: Relation, state: Values, goal: Values) -> str | None:
    """Return in words why a relation does not hold; None where it holds."""
    clearance = relation.clearance(state, goal)
    if clearance is None:
        return f"expected {relation}, but one of them is unknown"
    return None if clearance >= 0.0 else f"expected {relation}, it is {-float(clearance):.3g} m beyond"


def excess_of(relation: Relation, state: Values, goal: Values) -> float:
    """Return how far in m the place is out of the region, 0 within; infinite where one place is unknown."""
    clearance = relation.clearance(state, goal)
    return math.inf if clearance is None else max(0.0, -float(clearance))


def _way(origin: str, place: str, state: Values, goal: Values) -> tuple[Any, Any] | None:
    """Return the way in m from one place to another; None where one of them is unknown."""
    start, end = _position(origin, state, goal), _position(place, state, goal)
    if any(value is None for value in (*start, *end)):
        return None
    return end[0] - start[0], end[1] - start[1]


def _position(place: str, state: Values, goal: Values) -> tuple[Any, Any]:
    if place == "goal":
        return goal.get("x"), goal.get("y")
    return state.get(f"{place}.x"), state.get(f"{place}.y")
