"""Where a point of the floor is seen by a new client of the view."""

from __future__ import annotations

import math

import numpy as np

from ator_ros.page.serving import camera_over
from ator_ros.robot.description import Robot


def seen_at(
    robot: Robot, place: tuple[float, float, float], canvas: tuple[float, float, float, float]
) -> tuple[float, float]:
    """Return the pixel of a point (m) in a canvas: left, top, width, height in pixels."""
    position, look_at, fov = camera_over(robot)
    ahead = np.subtract(look_at, position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    ray = np.subtract(place, position)
    left, top, width, height = canvas
    scale = height / 2.0 / math.tan(fov / 2.0) / float(ray @ ahead)
    return left + width / 2.0 + scale * float(ray @ right), top + height / 2.0 - scale * float(ray @ up)
