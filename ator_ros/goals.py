"""Where the goals' walls are, for whoever must not drive into them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ator_ros.geometry import FloatArray
from ator_ros.robot import Robot
from ator_ros.world import Field


def touches_goals(poses: FloatArray, robot: Robot) -> bool:
    """Say whether any pose comes nearer to a goal's walls than the robot's reach.

    Parameters
    ----------
    poses : ndarray, shape (n, 3)
        x, y of the axle in m, yaw in rad.
    """
    near = np.abs(poses[:, 0]) > robot.field.length / 2 - robot.reach
    return bool(near.any()) and any(_touches_wall(poses[near], wall, robot) for wall in _walls(robot.field))


def _walls(field: Field) -> Sequence[tuple[float, float, float, float]]:
    """Give the boxes (x low, x high, |y| low, |y| high) of a goal, mirrored to x > 0 and y > 0."""
    line, half, depth = field.length / 2, field.goal_width / 2, field.goal_depth
    return ((line, line + depth, half, half + 0.05), (line + depth, line + depth + 0.05, 0.0, half))


def _touches_wall(poses: FloatArray, wall: tuple[float, float, float, float], robot: Robot) -> bool:
    x, y = np.abs(poses[:, 0]), np.abs(poses[:, 1])
    dx = np.maximum(np.maximum(wall[0] - x, x - wall[1]), 0.0)
    dy = np.maximum(np.maximum(wall[2] - y, y - wall[3]), 0.0)
    touching: NDArray[np.bool_] = np.hypot(dx, dy) < robot.reach
    return bool(touching.any())
