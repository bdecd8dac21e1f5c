"""Random poses in a scene's area, from which a robot arrives in time."""

from __future__ import annotations

import math

import numpy as np

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.situation import SHORT, NoPlaceError, drawn_until
from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose
from ator_ros.world.state import RobotState

SHORTEST = SHORT
"""Least distance in m between start and goal where the two are drawn independently."""
ALONE = 0.6
"""Share of the time limit for the straight path of an action; the rest is for turns."""
OF_TWO = 0.3
"""Share of the time limit for the straight path of each of two parts."""
BODY_ROOM = 0.1
"""Room in m between a robot and what it must not touch."""
_LEAST_END_MARGIN = 0.9  # m between starts or goals and the ends of an area with objects or bays
_LEAST_SIDE_MARGIN = 0.4  # m between them and its sides
_MOVING = 1.0 / 7.0  # share of starts in motion


def random_pose(robot: Robot, rng: np.random.Generator) -> Pose:
    """Draw a pose inside the margins, see `line_margins`.

    Raises NoPlaceError if there is none.
    """
    half_length, half_width = _half_sizes(robot)
    if min(half_length, half_width) < 0.0:
        raise NoPlaceError(
            f"{area_text(robot)}, expected more room between the lines than starts and goals keep "
            "from them"
        )
    x = rng.uniform(-half_length, half_length)
    y = rng.uniform(-half_width, half_width)
    return robot.scene.area.at(
        float(x),
        float(y),
        float(rng.uniform(-math.pi, math.pi)),
    )


def pose_within(
    robot: Robot,
    rng: np.random.Generator,
    of: Pose,
    low: float,
    high: float,
    *,
    held: bool = False,
) -> Pose:
    """Draw a pose `low` to `high` m from another.

    Parameters
    ----------
    robot : Robot
        The robot, with its scene.
    rng : numpy.random.Generator
        Source of random numbers.
    of : Pose
        The other pose.
    low, high : float
        Least and greatest distance in m.
    held : bool
        Whether both are poses of a held object. Then the axle, too, drives at most `high` m.

    Raises
    ------
    NoPlaceError
        There is no such pose.
    """

    def distance(pose: Pose) -> float:
        return distance_when_held(robot, of, pose) if held else of.distance(pose)

    return drawn_until(
        lambda: random_pose(robot, rng),
        lambda pose: low <= pose.distance(of) and distance(pose) <= high,
        lambda: (
            f"{area_text(robot)}, "
            f"expected room for starts and goals {low:.2f} to {high:.2f} m apart"
        ),
    )


def distance_when_held(robot: Robot, start: Pose, end: Pose) -> float:
    """Return the distance in m between two poses of a held object.

    It is that of the axle if that is greater.
    """
    axle_start = robot.pose_holding(start)
    axle_end = robot.pose_holding(end)
    return max(start.distance(end), axle_start.distance(axle_end))


def is_inside(place: Pose, robot: Robot) -> bool:
    """Return whether a place lies inside the margins, where `random_pose` draws."""
    half_length, half_width = _half_sizes(robot)
    area = robot.scene.area
    return abs(place.x - area.x) <= half_length and abs(place.y - area.y) <= half_width


def _half_sizes(robot: Robot) -> tuple[float, float]:
    area = robot.scene.area
    at_end, at_side = line_margins(robot)
    return area.length / 2 - at_end, area.width / 2 - at_side


def area_text(robot: Robot) -> str:
    """Return the size of the scene's area and the margins of a robot, for messages."""
    area = robot.scene.area
    at_end, at_side = line_margins(robot)
    return (
        f"scene.area: got {area.length:g} x {area.width:g} m, of whose lines robot {robot.name} "
        f"keeps {at_end:.2f} m at the ends and {at_side:.2f} m at the sides"
    )


def line_margins(robot: Robot) -> tuple[float, float]:
    """Return the least distances in m of starts and goals from the ends and the sides of the area.

    A robot has room to turn there. In a scene with objects or bays it also has room with a held
    object, and beside the bays.
    """
    room = robot.reach + BODY_ROOM
    if not robot.scene.objects and not robot.scene.bays:
        return room, room
    with_object = robot.hold + (robot.holder.radius if robot.holder else 0.0)
    at_end = max(_LEAST_END_MARGIN, room + with_object)
    at_side = max(_LEAST_SIDE_MARGIN, robot.half_width + BODY_ROOM)
    return at_end, at_side


def farthest(
    robot: Robot,
    share: float,
    least: float,
    *,
    holding: bool = False,
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
    holding : bool
        Whether the robot drives with an object in its holder.
    time_limit : float
        Time limit in s.

    Raises
    ------
    NoPlaceError
        The distance is less than `least`.
    """
    holds = holding and robot.holder is not None
    speed = robot.greatest_speed()
    if holds:
        speed = min(speed, robot.greatest_speed(holding=True))
    most = share * time_limit * speed
    if most < least:
        needed = least / (share * time_limit)
        load = " with an object" if holds else ""
        raise NoPlaceError(
            f"limits.v: expected {needed:.3f} m/s or more{load}, to drive {least:.2f} m in "
            f"{share * time_limit:g} of {time_limit:g} s, got {speed:g} m/s of robot {robot.name}"
        )
    return most


def random_start(
    robot: Robot,
    rng: np.random.Generator,
    goal: Pose,
    nearest: float,
    *,
    time_limit: float = TIME_LIMIT,
) -> RobotState:
    """Draw a state from which the robot can drive to a goal in time; one of seven is in motion.

    It is at least `nearest` m from the goal. Raises NoPlaceError without room.
    """
    most = farthest(robot, ALONE, nearest, time_limit=time_limit)
    start = pose_within(robot, rng, goal, nearest, most)
    if rng.random() >= _MOVING:
        return RobotState(start)
    velocity = robot.draw_velocity(rng)
    return RobotState(start, velocity.vx, velocity.w, vy=velocity.vy)
