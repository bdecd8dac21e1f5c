"""The walls of two equal bays at the ends of a scene's area, such as the goals of a field."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.compiled import elementwise
from ator_ros.geometry import FloatArray
from ator_ros.world.scene import WALL_THICKNESS


class EndBays(NamedTuple):
    """The bays in m, relative to the center of the area and mirrored to x, y >= 0."""

    line: float
    """Distance along x at which the walls begin; infinite without bays."""
    half_width: float
    """Half the inner width; 0 without bays."""
    depth: float
    """The inner depth; 0 without bays."""


def end_bays(robot: Robot) -> EndBays:
    """Return the bays of a robot's scene, which are equal and at the ends of its area."""
    if not robot.scene.bays:
        return EndBays(math.inf, 0.0, 0.0)
    bay = robot.scene.bays[0]
    return EndBays(
        line=float(robot.scene.area.length / 2),
        half_width=float(bay.width / 2),
        depth=float(bay.depth),
    )


def touches_walls(poses: FloatArray, robot: Robot) -> bool:
    """Return whether the robot may touch the wall of a bay at any of the poses.

    Poses have the shape (n, 3): x, y in m, yaw in rad.
    """
    return depth_in_walls(poses, robot) > 0.0


def depth_in_walls(places: FloatArray, robot: Robot) -> float:
    """Return the greatest depth in m to which the robot may reach into the wall of a bay.

    `places` are those of the axle in m, shape (n, 2) or more columns.
    """
    area = robot.scene.area
    bays = end_bays(robot)
    x, y = np.abs(places[:, :2] - (area.x, area.y)).T
    near = x > nearest_to_walls(robot)
    walls = wall_distance(x[near], y[near], bays)
    return float(np.max(robot.reach - walls, initial=0.0))


def nearest_to_walls(robot: Robot) -> float:
    """Return the distance in m from the center along x up to which the robot touches no wall."""
    return end_bays(robot).line - robot.reach


@elementwise
def wall_distance(x: Any, y: Any, bays: EndBays) -> Any:
    """Return the distance in m to the walls of the bays.

    Places are relative to the center, mirrored to x, y >= 0.
    """
    back = bays.line + bays.depth
    half = bays.half_width
    side = box_distance(x, y, bays.line, back, half, half + WALL_THICKNESS)
    return np.minimum(side, box_distance(x, y, back, back + WALL_THICKNESS, 0.0, half))


@elementwise
def box_distance(
    x: Any,
    y: Any,
    x_low: float,
    x_high: float,
    y_low: float,
    y_high: float,
) -> Any:
    """Return the distance in m from places to a box along the axes; 0 inside.

    Places are numbers or arrays of one shape, which is that of the result.
    """
    along = np.maximum(np.maximum(x_low - x, x - x_high), 0.0)
    across = np.maximum(np.maximum(y_low - y, y - y_high), 0.0)
    return np.hypot(along, across)
