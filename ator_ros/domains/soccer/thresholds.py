"""Lengths and speeds that depend on the robot, derived from its description."""

from __future__ import annotations

import functools
from types import MappingProxyType

from ator_ros.actions.base import ActionError
from ator_ros.bases.description import Robot
from ator_ros.domains.places import BODY_ROOM
from ator_ros.domains.soccer.field import BALL
from ator_ros.tops.ranges import USUAL_RANGES, Ranges, arrival_speed
from ator_ros.world.state import World

ARRIVAL_SPEED = 0.8
"""Greatest arrival speed in m/s, of searches and of situations to learn from."""

RANGES: Ranges = MappingProxyType(
    {**USUAL_RANGES, "speed": functools.partial(arrival_speed, most=ARRIVAL_SPEED)}
)
_LEAST_CLEARANCE = 0.6  # m between axle and ball: room to turn with a usual robot


def approach_run(robot: Robot) -> float:
    """Return the length in m of the straight run to a ball: twice that of the fins, and 1 cm."""
    return 2.0 * robot.holder_length + 0.01


def caught_within(robot: Robot) -> float:
    """Return the distance in m from the hold up to which a ball is caught.

    It is half the length of the fins: less than that of `is_held`, so that the ball is not lost in
    the first turn.
    """
    return 0.5 * robot.holder_length


def lost_ball(world: World, robot: Robot) -> str | None:
    """Return a message if the ball is out of the hold; else None."""
    distance = robot.hold_offset(world, BALL)
    lost = distance > 1.25 * robot.holder_length
    return f"lost the ball: it is {distance:.2f} m from the hold" if lost else None


def check_held(world: World, robot: Robot, action: str) -> None:
    """Raise ActionError unless the ball is in the hold."""
    if lost_ball(world, robot):
        distance = robot.hold_offset(world, BALL)
        raise ActionError(
            f"{action}: expected the ball in front, it is {distance:.2f} m from the hold"
        )


def ball_clearance(robot: Robot) -> float:
    """Return the distance in m between axle and ball at which they do not touch at any heading."""
    touching = robot.reach + robot.scene.objects[BALL].radius
    return max(_LEAST_CLEARANCE, touching + BODY_ROOM)


def greatest_arrival(robot: Robot) -> float:
    """Return the greatest speed in m/s at which a robot may arrive at a ball or with it."""
    speeds = [robot.greatest_speed(holding=holds) for holds in {False, robot.holder is not None}]
    return min(ARRIVAL_SPEED, *speeds)
