"""Random situations in which soccer actions gather experience (paper, section 3)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.actions.situation import Situation, drawn_until, short_goal
from ator_ros.bases.description import Robot
from ator_ros.domains.places import (
    ALONE,
    SHORTEST,
    area_text,
    farthest,
    is_inside,
    pose_within,
    random_pose,
    random_start,
)
from ator_ros.domains.planned.walls import touches_walls
from ator_ros.domains.soccer.field import BALL, field_of, objects_of
from ator_ros.domains.soccer.shoot import Shoot
from ator_ros.domains.soccer.thresholds import (
    ball_clearance,
    greatest_arrival,
)
from ator_ros.geometry import Pose
from ator_ros.world.state import ObjectState, RobotState, World

_LEAVING = 0.04  # share of drives that start with a held ball and end elsewhere
# m between the ball and the middle of the goal line at the start of a shot
_SHOT_RANGE = (0.6, 2.5)
_DRAWS = 200  # draws before giving up; each is planned, which takes 5 ms
T = TypeVar("T")


def _speed(
    robot: Robot,
    rng: np.random.Generator,
    share: float,
) -> float:
    """Draw a speed in m/s up to the greatest arrival speed; 0 except in a `share` of the cases."""
    speed = float(rng.uniform(0.0, greatest_arrival(robot)))
    return speed if rng.random() < share else 0.0


def go_to_pose(
    robot: Robot, rng: np.random.Generator, *, time_limit: float = TIME_LIMIT
) -> Situation:
    """Draw a drive to a ball, every second time with an arrival speed, or to a pose.

    Straight paths take at most 0.6 of `time_limit` (s). Raises NoPlaceError without room.

    One start in seven is in motion. One drive in seven is short, see `short_goal`. Without a holder
    or a ball in the scene, all are drives to a pose.
    """
    # first, so that a scene without room is reported
    situation = _long_drive(robot, rng, time_limit)
    start = situation.robot.pose
    short = short_goal(start, rng)
    if short is not None and is_inside(short, robot):
        return Situation(
            "goToPose",
            RobotState(start),
            {},
            Goal(short, 0.0, Point.AXLE),
        )
    leaves = rng.random() < _LEAVING and robot.holder is not None and BALL in robot.scene.objects
    return (_leave_ball(robot, rng) if leaves else None) or situation


def _long_drive(
    robot: Robot,
    rng: np.random.Generator,
    time_limit: float,
) -> Situation:
    """Draw a drive whose start and goal are drawn independently."""
    with_ball = rng.random() < 0.75 and robot.holder is not None and BALL in robot.scene.objects
    goal = random_pose(robot, rng)
    nearest = ball_clearance(robot) if with_ball else SHORTEST
    state = random_start(robot, rng, goal, nearest, time_limit=time_limit)
    if not with_ball:
        return Situation("goToPose", state, {}, Goal(goal, 0.0, Point.AXLE))
    arrival = Goal(goal, _speed(robot, rng, 0.5), Point.HOLD)
    return Situation(
        "goToPose",
        state,
        {BALL: ObjectState(goal.x, goal.y)},
        arrival,
    )


def _leave_ball(robot: Robot, rng: np.random.Generator) -> Situation | None:
    """Draw a drive away from a held ball; None if the robot is too slow."""
    state, ball = _holding(
        robot,
        robot.pose_holding(random_pose(robot, rng)),
        0.0,
    )
    nearest = ball_clearance(robot)
    held = Pose(ball.x, ball.y, 0.0)
    most = farthest(robot, ALONE, nearest) - held.distance(state.pose)  # of the axle
    if most <= nearest + SHORTEST:
        return None
    there = pose_within(robot, rng, held, nearest, most)
    return Situation(
        "goToPose",
        state,
        objects_of(ball),
        Goal(there, 0.0, Point.AXLE),
    )


def _holding(
    robot: Robot,
    pose: Pose,
    speed: float,
) -> tuple[RobotState, ObjectState]:
    """Return the states of robot and held ball at a speed in m/s."""
    ball = robot.hold_point(pose)
    vx = speed * math.cos(pose.yaw)
    vy = speed * math.sin(pose.yaw)
    return RobotState(pose, speed), ObjectState(ball.x, ball.y, vx, vy)


def dribble_ball(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a dribble.

    Every second dribble starts in motion, and one in seven is short, see `short_goal`. Raises
    ConfigError for a robot without a holder, and NoPlaceError without room.
    """
    robot.holder_for("dribbleBall")
    goal = random_pose(robot, rng)
    most = farthest(robot, ALONE, SHORTEST, holding=True)
    ball = pose_within(robot, rng, goal, SHORTEST, most, held=True)
    speed = _speed(robot, rng, 0.5)
    arrival = Goal(goal, _speed(robot, rng, 0.3), Point.HOLD)
    short = short_goal(ball, rng, turns=False)
    if short is not None and is_inside(short, robot):
        speed = 0.0
        arrival = Goal(short, 0.0, Point.HOLD)
    state, rolling = _holding(robot, robot.pose_holding(ball), speed)
    return Situation("dribbleBall", state, objects_of(rolling), arrival)


def shoot(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a shot from up to 2.5 m before the goal; every second one starts in motion."""
    robot.holder_for("shoot")
    x, y = field_of(robot).goal_center()
    area = robot.scene.area

    def is_usable(pose: Pose) -> bool:
        ball = robot.hold_point(pose)
        on_floor = area.has_floor(pose.x, pose.y) and area.has_floor(ball.x, ball.y)
        return on_floor and not touches_walls(np.array([pose]), robot)

    start = drawn_until(
        lambda: _shooting_pose(robot, rng),
        is_usable,
        lambda: (
            f"{area_text(robot)}, "
            f"expected room before the goal for a robot that reaches {robot.reach:.2f} m"
        ),
    )
    state, rolling = _holding(robot, start, _speed(robot, rng, 0.5))
    return Situation(
        "shoot",
        state,
        objects_of(rolling),
        Goal(Pose(x, y, 0.0), 0.0, Point.HOLD),
    )


def _shooting_pose(robot: Robot, rng: np.random.Generator) -> Pose:
    """Draw a pose of the robot with the ball in range of the goal."""
    x, y = field_of(robot).goal_center()
    # from the goal's axis, without places beside the goal
    bearing = rng.uniform(-0.45, 0.45) * math.pi
    nearest, most = _SHOT_RANGE
    most = min(most, farthest(robot, ALONE, nearest, holding=True))
    distance = rng.uniform(nearest, most)
    ball = Pose(
        x - float(distance * math.cos(bearing)),
        y + float(distance * math.sin(bearing)),
        float(rng.uniform(-math.pi, math.pi)),
    )
    return robot.pose_holding(ball)


def shoot_with_room(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a shot for which the planned action finds a run-up.

    Raises NoPlaceError if the robot is too large.
    """
    return with_room(robot, lambda: shoot(robot, rng), lambda situation: situation)


def with_room(
    robot: Robot,
    draw: Callable[[], T],
    shot: Callable[[T], Situation],
) -> T:
    """Draw until the planned action finds a run-up for the shot.

    Parameters
    ----------
    robot : Robot
        The robot.
    draw : callable
        Draws something with a shot.
    shot : callable
        Returns the situation of the shot.

    Raises
    ------
    NoPlaceError
        The action finds no run-up in 200 draws.
    """
    return drawn_until(
        draw,
        lambda drawn: _has_room(robot, shot(drawn)),
        lambda: (
            f"shoot: expected room for a run-up to the goal, robot {robot.name} reaches "
            f"{robot.reach:.2f} m from its axle"
        ),
        most=_DRAWS,
    )


def _has_room(robot: Robot, situation: Situation) -> bool:
    action = Shoot(robot)
    try:
        action.start(World(0.0, situation.robot, situation.objects), situation.goal)
    except ActionError:
        return False
    action.end("checked for room")
    return True
