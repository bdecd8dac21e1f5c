"""The goal as seen from the hold, the point in front of the robot at which it holds an object."""

from __future__ import annotations

import numpy as np

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.performance.derived import Geometry


def _from_hold(geometry: Geometry) -> tuple[FloatArray, FloatArray]:
    """Return the way in m, along x and y, from the hold at the start to the goal's position."""
    d, hold = geometry.direct, geometry.robot.hold
    dx = d["xg"] - d["x"] - hold * np.cos(d["yaw"])
    dy = d["yg"] - d["y"] - hold * np.sin(d["yaw"])
    return dx, dy


def hold_dist(geometry: Geometry) -> FloatArray:
    """Return the distance in m from the hold at the start to the goal's position."""
    dx, dy = geometry.once(_from_hold)
    return np.asarray(np.sqrt(dx * dx + dy * dy))


def hold_bearing(geometry: Geometry) -> FloatArray:
    """Return the bearing in rad, in the world, of the goal's position seen from the hold at the start."""
    dx, dy = geometry.once(_from_hold)
    return np.arctan2(dy, dx)


def hold_angle(geometry: Geometry) -> FloatArray:
    """Return the signed angle in rad from the heading to the goal's position, seen from the hold."""
    return wrap_angles(geometry.once(hold_bearing) - geometry.direct["yaw"])
