"""The far side of an object: where a robot stands that will take it on toward a place."""

from __future__ import annotations

import math

from ator_ros.geometry import wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.world.state import World

_BEHIND = math.radians(60.0)
"""Angle between the way to an object and the way on from it, up to which the robot is behind it already."""
_ROOM = 0.3
"""Free way in m between the robot there and the object."""


def far_side(
    world: World, robot: Robot, name: str, toward: tuple[float, float]
) -> tuple[float, float] | None:
    """Return the place (m) behind an object, seen from where it shall go.

    None where the robot is behind it already, or where the place is not in the scene's area.
    """
    there, at = world.objects.get(name), world.robot.pose
    if there is None:
        return None
    onward = math.atan2(toward[1] - there.y, toward[0] - there.x)
    approach = math.atan2(there.y - at.y, there.x - at.x)
    if abs(wrap_angle(approach - onward)) <= _BEHIND:
        return None
    away = robot.reach + robot.scene.radius(name) + _ROOM
    x, y = there.x - away * math.cos(onward), there.y - away * math.sin(onward)
    x_min, y_min, x_max, y_max = robot.scene.area.lines
    inside = x_min <= x <= x_max and y_min <= y <= y_max
    return (x, y) if inside else None
