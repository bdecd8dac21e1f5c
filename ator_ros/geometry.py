"""Angles, poses and frames in the plane (SI units, radians, x forward, y left, REP-103)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
Records = NDArray[np.void]
"""An array of records."""
Record: TypeAlias = Any
"""One record of such an array; its fields are attributes, see `record_type`."""


def record_type(fields: Sequence[tuple[Any, ...]]) -> np.dtype[np.void]:
    """Return the type of records with these fields: name, type and, for an array, its shape.

    Fields are read and written as attributes of a record, in compiled code as in Python.
    """
    return np.dtype((np.record, [*fields]))


class Pose(NamedTuple):
    """A pose in the plane."""

    x: float  # m
    y: float  # m
    yaw: float  # heading in rad, counter-clockwise from the x axis

    def compose(self, local: Pose) -> Pose:
        """Return the pose `local`, which is relative to this pose, in the frame of this pose."""
        c = math.cos(self.yaw)
        s = math.sin(self.yaw)
        return Pose(
            self.x + c * local.x - s * local.y,
            self.y + s * local.x + c * local.y,
            wrap_angle(self.yaw + local.yaw),
        )

    def relative(self, other: Pose) -> Pose:
        """Return the pose `other`, given in the same frame as this pose, relative to this pose."""
        dx = other.x - self.x
        dy = other.y - self.y
        c = math.cos(self.yaw)
        s = math.sin(self.yaw)
        return Pose(c * dx + s * dy, -s * dx + c * dy, wrap_angle(other.yaw - self.yaw))

    def ahead(self, distance: float) -> Pose:
        """Return this pose moved `distance` m along its heading (negative: backward)."""
        return Pose(
            self.x + distance * math.cos(self.yaw), self.y + distance * math.sin(self.yaw), self.yaw
        )

    def distance(self, other: Pose) -> float:
        """Return the distance in m between the two positions."""
        return math.hypot(other.x - self.x, other.y - self.y)


def as_float(value: float) -> float:
    """Return a whole number as a float, any other value as it is.

    Compiled code would be compiled again for whole numbers, or fail.
    """
    return float(value) if isinstance(value, (int, np.integer)) else value


def decimal_pose(pose: Pose) -> Pose:
    """Return a pose whose whole numbers are floats; see `as_float`."""
    x, y, yaw = pose
    if type(x) is type(y) is type(yaw) is float:
        return pose
    return Pose(as_float(x), as_float(y), as_float(yaw))


def wrap_angle(angle: float) -> float:
    """Return the same angle in [-pi, pi) rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def wrap_angles(angles: Any) -> FloatArray:
    """Return the same angles in [-pi, pi) rad, of any shape."""
    return np.asarray((np.asarray(angles, dtype=float) + np.pi) % (2.0 * np.pi) - np.pi)


def yaw_from_quaternion(
    x: float,
    y: float,
    z: float,
    w: float,
) -> float:
    """Return the heading in rad of a unit quaternion."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion_from_yaw(yaw: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion (x, y, z, w) of a heading in rad."""
    return 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)


def clip(value: float, bound: float) -> float:
    """Return `value` clipped to [-bound, bound]."""
    return max(-bound, min(bound, value))
