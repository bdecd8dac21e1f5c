"""Checks of incoming messages. Every error names the field, what was expected, and what came."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sized
from dataclasses import dataclass
from typing import Any

from ator_ros.files import is_name
from ator_ros.geometry import yaw_from_quaternion
from ator_ros.printable import quoted
from ator_ros.robot.description import Robot

FARTHEST = 1000.0
"""Greatest coordinate in m that is accepted for any robot."""
FASTEST = 100.0
"""Greatest velocity in m/s or rad/s that is accepted for any robot."""
FASTEST_OBJECT = 10.0
"""Greatest velocity in m/s that is believed of an object in a robot's area."""
MOST_ITEMS = 64
"""Items of a sequence that are converted: twice the longest sequence that is accepted."""
LONGEST_NAME = 200
"""Greatest number of characters in a name."""
_UNIT_TOLERANCE = 1e-3
_TILT_TOLERANCE = 0.02


class MessageError(ValueError):
    """A message that cannot be used; the text says which field, what was expected and what came."""


@dataclass(frozen=True, slots=True)
class MessageBounds:
    """Greatest values accepted in messages, in each direction.

    Attributes
    ----------
    x, y : float
        Coordinates in m.
    v, w : float
        The robot's velocities in m/s and rad/s.
    object_speed : float
        An object's velocity along x and y in m/s.
    """

    x: float = FARTHEST
    y: float = FARTHEST
    v: float = FASTEST
    w: float = FASTEST
    object_speed: float = FASTEST


WIDEST = MessageBounds()
"""Bounds for messages about any robot."""


def bounds_of(robot: Robot) -> MessageBounds:
    """Return what is believed of `robot` and its area: twice the floor, three times its limits."""
    area, limits = robot.scene.area, robot.limits
    return MessageBounds(
        area.length + 2.0 * area.margin,
        area.width + 2.0 * area.margin,
        3.0 * limits.v,
        3.0 * limits.w,
        FASTEST_OBJECT,
    )


def number(value: float, where: str, *, low: float, high: float, unit: str = "") -> float:
    """Return `value` if it is a finite number in [low, high].

    Raises
    ------
    MessageError
        `value` is not finite, or out of bounds.
    """
    if not (math.isfinite(value) and low <= value <= high):
        bounds = f"a finite number from {low:g} to {high:g} {unit}".rstrip()
        raise MessageError(f"{where}: expected {bounds}, got {value!r}")
    return float(value)


def position(value: float, where: str, *, most: float = FARTHEST) -> float:
    """Return a coordinate in m if its magnitude is at most `most`; raise MessageError otherwise."""
    return number(value, where, low=-most, high=most, unit="m")


def velocity(value: float, where: str, unit: str = "m/s", *, most: float = FASTEST) -> float:
    """Return a velocity if its magnitude is at most `most`; raise MessageError otherwise."""
    return number(value, where, low=-most, high=most, unit=unit)


def zero(values: Iterable[float], where: str) -> None:
    """Raise MessageError unless all components that have no meaning in the plane are 0."""
    values = tuple(values)
    if any(value != 0.0 for value in values):
        raise MessageError(f"{where}: expected 0, since the robot moves in the plane, got {values}")


def planar_yaw(quaternion: Any, where: str) -> float:
    """Return the heading in rad of a quaternion that has unit length, roll 0 and pitch 0.

    Raises
    ------
    MessageError
        It is not finite, not of unit length, or tilted.
    """
    parts = (quaternion.x, quaternion.y, quaternion.z, quaternion.w)
    length = math.hypot(*parts)
    if not abs(length - 1.0) <= _UNIT_TOLERANCE:
        raise MessageError(f"{where}: expected a quaternion (x, y, z, w) of length 1, got {parts}")
    if math.hypot(quaternion.x, quaternion.y) > _TILT_TOLERANCE:
        raise MessageError(f"{where}: expected roll and pitch 0, got the quaternion (x, y, z, w) {parts}")
    return yaw_from_quaternion(*parts)


def frame(frame_id: str, where: str, *, expected: str) -> None:
    """Raise MessageError unless a frame is the expected one, or empty, which means the same."""
    if frame_id not in ("", expected):
        raise MessageError(f"{where}: expected the frame {quoted(expected)}, got {quoted(frame_id)}")


def name(text: str, where: str, *, allowed: Collection[str]) -> str:
    """Return a name if it is allowed; raise MessageError otherwise."""
    if len(text) > LONGEST_NAME or text not in allowed:
        raise MessageError(f"{where}: expected one of {sorted(allowed)}, got {quoted(text)}")
    return text


def plain_name(text: str, where: str) -> str:
    """Return a short name of letters, digits and _; raise MessageError for any other text."""
    if len(text) > LONGEST_NAME or not is_name(text):
        raise MessageError(f"{where}: expected a name of letters, digits and _, got {quoted(text)}")
    return text


def count(items: Sized, where: str, *, least: int, most: int) -> None:
    """Raise MessageError unless there are `least` to `most` items."""
    if not least <= len(items) <= most:
        expected = f"{least}" if least == most else f"{least} to {most}"
        more = " or more" if len(items) >= MOST_ITEMS else ""
        raise MessageError(f"{where}: expected {expected} items, got {len(items)}{more}")


def names(items: Collection[str], where: str, *, allowed: Collection[str]) -> frozenset[str]:
    """Return the names as a set if all are allowed and none comes twice.

    Raises
    ------
    MessageError
        A name is not allowed, or comes twice.
    """
    expected = f"{where}: expected names of {sorted(allowed)}, each once"
    if len(items) > len(allowed):
        more = " or more" if len(items) >= MOST_ITEMS else ""
        raise MessageError(f"{expected}, got {len(items)}{more} items")
    unknown = [item for item in items if len(item) > LONGEST_NAME or item not in allowed]
    if unknown:
        raise MessageError(f"{expected}, got {quoted(unknown[0])}")
    if len(set(items)) != len(items):
        raise MessageError(f"{expected}, got a name twice")
    return frozenset(items)
