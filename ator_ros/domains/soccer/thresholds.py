"""Lengths and speeds that depend on the robot, derived from its description."""

from __future__ import annotations

import functools
from types import MappingProxyType

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import ActionError, Goal
from ator_ros.actions.situation import NoPlaceError
from ator_ros.bases.description import Robot
from ator_ros.domains.soccer.field import BALL
from ator_ros.tops.ranges import USUAL_RANGES, Ranges, arrival_speed
from ator_ros.world.state import World

ARRIVAL_SPEED = 0.8
"""Greatest arrival speed in m/s, of searches and of situations to learn from."""

RANGES: Ranges = MappingProxyType(
    {**USUAL_RANGES, "speed": functools.partial(arrival_speed, most=ARRIVAL_SPEED)}
)
_BODY_ROOM = 0.1  # m between a robot and what it must not touch
_LEAST_END_MARGIN = 0.9  # m between starts or goals and the goal lines
_LEAST_SIDE_MARGIN = 0.4  # m between starts or goals and the side lines
_LEAST_CLEARANCE = 0.6  # m between axle and ball


def check_arrival(goal: Goal, most: float, action: str) -> None:
    """Raise ActionError unless the goal's arrival speed is from 0 to `most` m/s."""
    if not 0.0 <= goal.speed <= most:
        raise ActionError(
            f"{action}: expected an arrival speed from 0 to {most:g} m/s, got {goal.speed:g}"
        )


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
    return max(_LEAST_CLEARANCE, touching + _BODY_ROOM)


def line_margins(robot: Robot) -> tuple[float, float]:
    """Return the least distances in m of starts and goals from goal lines and side lines.

    A robot has room to turn there. In a scene with objects or bays it also has room with a ball,
    and beside the posts.
    """
    room = robot.reach + _BODY_ROOM
    if not robot.scene.objects and not robot.scene.bays:
        return room, room
    with_ball = robot.hold + (robot.holder.radius if robot.holder else 0.0)
    at_end = max(_LEAST_END_MARGIN, room + with_ball)
    at_side = max(_LEAST_SIDE_MARGIN, robot.half_width + _BODY_ROOM)
    return at_end, at_side


def farthest(
    robot: Robot,
    share: float,
    least: float,
    *,
    with_ball: bool = False,
    time_limit: float = TIME_LIMIT,
) -> float:
    """Return the distance in m that a robot drives at full speed in a share of the time limit.

    The samplers draw no goal beyond it: a slow robot would not arrive in time.

    Parameters
    ----------
    robot : Robot
        The robot.
    share : float
        Share of the time limit.
    least : float
        Least distance in m that is drawn.
    with_ball : bool
        Whether the robot drives with the ball.
    time_limit : float
        Time limit in s.

    Raises
    ------
    NoPlaceError
        The distance is less than `least`.
    """
    holds = with_ball and robot.holder is not None
    speed = robot.greatest_speed()
    if holds:
        speed = min(speed, robot.greatest_speed(holding=True))
    most = share * time_limit * speed
    if most < least:
        needed = least / (share * time_limit)
        load = " with the ball" if holds else ""
        raise NoPlaceError(
            f"limits.v: expected {needed:.3f} m/s or more{load}, to drive {least:.2f} m in "
            f"{share * time_limit:g} of {time_limit:g} s, got {speed:g} m/s of robot {robot.name}"
        )
    return most


def greatest_arrival(robot: Robot) -> float:
    """Return the greatest speed in m/s at which a robot may arrive at a ball or with it."""
    speeds = [robot.greatest_speed(holding=holds) for holds in {False, robot.holder is not None}]
    return min(ARRIVAL_SPEED, *speeds)
