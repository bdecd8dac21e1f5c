"""Distances of the robot to the walls of the goals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ator_ros.domains.soccer.field import Field, field_of
from ator_ros.geometry import FloatArray
from ator_ros.robot.description import Robot
from ator_ros.world.scene import WALL_THICKNESS


def touches_goals(poses: FloatArray, robot: Robot) -> bool:
    """Return whether the robot, at any of the poses, may touch the wall of a goal.

    Parameters
    ----------
    poses : ndarray, shape (n, 3)
        x, y of the axle in m, yaw in rad.
    """
    return depth_in_goals(poses, robot) > 0.0


def depth_in_goals(places: FloatArray, robot: Robot) -> float:
    """Return by how much in m the robot, at the worst of the places, may reach into the wall of a goal.

    Parameters
    ----------
    places : ndarray, shape (n, 2) or more columns
        x, y of the axle in m.
    """
    field = field_of(robot)
    near = places[np.abs(places[:, 0] - field.x) > nearest_to_goals(robot), :2]
    return float(np.max(robot.reach - wall_distances(near - (field.x, field.y), field), initial=0.0))


def nearest_to_goals(robot: Robot) -> float:
    """Return the distance in m from the centre along x within which the robot touches no goal."""
    return field_of(robot).walls_begin - robot.reach


def wall_distances(poses: FloatArray, field: Field) -> FloatArray:
    """Compute the distance in m to the nearest wall from places relative to the centre, shape (n, 2 or 3)."""
    x, y = np.abs(poses[:, 0]), np.abs(poses[:, 1])
    distances = [
        np.hypot(
            np.maximum(np.maximum(wall[0] - x, x - wall[1]), 0.0),
            np.maximum(np.maximum(wall[2] - y, y - wall[3]), 0.0),
        )
        for wall in _walls(field)
    ]
    return np.minimum(*distances)


def _walls(field: Field) -> Sequence[tuple[float, float, float, float]]:
    """Return the boxes (x low, x high, |y| low, |y| high) of a goal, mirrored to x > 0 and y > 0."""
    line, half, depth = field.length / 2, field.goal_width / 2, field.goal_depth
    back = line + depth
    return (line, back, half, half + WALL_THICKNESS), (back, back + WALL_THICKNESS, 0.0, half)
