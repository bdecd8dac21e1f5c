"""The end of every run-up: accelerate straight ahead, then release the ball to roll between the posts."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np

from ator_ros.domains.soccer.field import BALL, field_of
from ator_ros.geometry import BoolArray, FloatArray, Pose
from ator_ros.motion.durations import drive_time
from ator_ros.motion.manoeuvre import Manoeuvre
from ator_ros.robot.description import Limits, Robot

SLANT = math.radians(60.0)  # greatest angle between a shot and the goal's axis
# Share of the way that a ball rolls out which it is sent: the rest makes up for losses. The robot, which
# brakes harder than the ball, then comes to rest with its axle before the line.
_ROLL_SHARE = 0.62
_DOUBT = 1e-9  # m
ROOM = 0.05  # m between the robot and the goal's posts and walls
_AIMS = (-0.6, -0.3, 0.0, 0.3, 0.6)  # shares of half the goal's width
_SLANTS = tuple(math.radians(angle) for angle in (-50.0, -25.0, 0.0, 25.0, 50.0))


class Release(NamedTuple):
    """How the ball is released; arrays of one shape.

    Attributes
    ----------
    allowed : ndarray of bool
        The ball rolls between the posts, and the robot brakes without touching the goal.
    distance : ndarray
        How far the robot still drives straight on, in m; NaN, as speed and time, where the mouth is missed.
    speed : ndarray
        Speed in m/s at which it then lets go.
    time : ndarray
        Time in s from the beginning of the straight until the ball is wholly behind the line.
    """

    allowed: BoolArray
    distance: FloatArray
    speed: FloatArray
    time: FloatArray


def release(
    robot: Robot, x: FloatArray, y: FloatArray, heading: FloatArray, speed: FloatArray, limits: Limits
) -> Release:
    """Compute when to release a ball that is pushed straight at a goal, for many ways to push it.

    Parameters
    ----------
    x, y, heading : ndarray
        Poses of the axle where the straight begins (m, rad), in the frame of the goal's mouth: x points out
        of the field.
    speed : ndarray
        Speeds there in m/s.

    Notes
    -----
    All arrays broadcast. The ball is let go as soon as `_ROLL_SHARE` of its rolling out is enough.
    """
    c, s = np.cos(heading), np.sin(heading)
    ball_x, ball_y = x + robot.hold * c, y + robot.hold * s
    way = (robot.scene.radius(BALL) - ball_x) / c
    crossing = ball_y - ball_x * s / c
    room = (field_of(robot).goal_width / 2.0 - np.abs(crossing)) * c - robot.reach
    allowed = np.asarray((way >= 0.0) & (room >= ROOM) & (np.abs(heading) <= SLANT))
    result = Release(allowed, *(np.full(allowed.shape, np.nan) for _ in range(3)))
    # Most ways to push miss the mouth: the rest is computed for those that do not.
    x, y, c, s, way, speed = (each[allowed] for each in np.broadcast_arrays(x, y, c, s, way, speed))
    roll = roll_of(robot)
    gaining = (way - roll * speed * speed) / (1.0 + 2.0 * roll * limits.a)
    pushed = np.maximum(np.maximum(gaining, way - roll * limits.v * limits.v), 0.0)
    reached = np.sqrt(np.maximum(speed * speed + 2.0 * limits.a * pushed, 0.0))
    released = np.minimum(reached, limits.v)
    # A turn may end later than where the ball could be let go, as long as the robot stops inside the goal.
    stop = pushed + released * released / (2.0 * robot.limits.brake)
    inside = field_of(robot).goal_depth - robot.reach - (x + stop * c)
    beside = field_of(robot).goal_width / 2.0 - robot.reach - np.abs(y + stop * s)
    result.distance[allowed], result.speed[allowed] = pushed, released
    result.time[allowed] = drive_time(pushed, speed, released, limits) + _rolling_time(
        robot, released, way - pushed
    )
    allowed[allowed] = np.minimum(inside, beside) >= ROOM
    return result


def may_score(
    robot: Robot, x: FloatArray, y: FloatArray, heading: FloatArray, yaw: float, leads: FloatArray
) -> BoolArray:
    """Return which straights may lead between the posts: all that `release` allows, and some others.

    Parameters
    ----------
    x, y : ndarray, shape (sides, turns)
        Where the straights begin without their lead, in m, in the frame of the goal's mouth.
    heading : ndarray, shape (turns,)
        Headings of the straights in rad, at most `SLANT`.
    yaw : float
        Heading of the leads in rad.
    leads : ndarray, shape (sides, leads)
        Leads in m, each of which moves the beginning.

    Returns
    -------
    ndarray of bool, shape (sides, leads, turns)
    """
    c, s = np.cos(heading), np.sin(heading)
    ball_x, ball_y, tangent = x + robot.hold * c, y + robot.hold * s, s / c
    widest = field_of(robot).goal_width / 2.0 - (robot.reach + ROOM) / c + _DOUBT
    aside = (math.sin(yaw) - math.cos(yaw) * tangent) * leads[:, :, None]
    aside += (ball_y - ball_x * tangent)[:, None]
    before = (math.cos(yaw) * leads)[:, :, None] <= (robot.scene.radius(BALL) + _DOUBT - ball_x)[:, None]
    return np.asarray((np.abs(aside) <= widest) & before)


def release_poses(robot: Robot, mouth: Pose, limits: Limits) -> list[Pose]:
    """Return some poses of the axle in the world at which a ball pushed at full speed is released.

    Parameters
    ----------
    mouth : Pose
        Middle of the goal's mouth, heading out of the field.
    """
    half, poses = field_of(robot).goal_width / 2.0, []
    for aim, slant in itertools.product(_AIMS, _SLANTS):
        if half * (1.0 - abs(aim)) * math.cos(slant) - robot.reach >= ROOM:
            line = robot.scene.radius(BALL) / math.cos(slant)
            back = roll_of(robot) * limits.v * limits.v - line + robot.hold
            poses.append(mouth.compose(Pose(0.0, aim * half, slant)).ahead(-back))
    return poses


def scoring_time(robot: Robot, mouth: Pose, plan: Manoeuvre) -> float:
    """Compute the time in s from the start of a run-up until the ball is wholly behind the line."""
    return plan.duration + rolling_time(robot, mouth, plan.goal, plan.exit.outer_speed)


def rolling_time(robot: Robot, mouth: Pose, released: Pose, speed: float) -> float:
    """Compute the time in s from the release, there at `speed` (m/s), until the ball is behind the line."""
    ball = mouth.relative(released).ahead(robot.hold)
    way = (robot.scene.radius(BALL) - ball.x) / math.cos(ball.yaw)
    return float(_rolling_time(robot, speed, way))


def _rolling_time(robot: Robot, speed: Any, way: Any) -> FloatArray:
    """Return the time in s in which a ball released at `speed` (m/s) rolls `way` m."""
    deceleration = robot.scene.objects[BALL].rolling_deceleration
    left = np.sqrt(np.maximum(speed * speed - 2.0 * deceleration * way, 0.0))
    return np.asarray((speed - left) / deceleration)


def usual_release(robot: Robot) -> float:
    """Return how far before the goal line, in m, a ball is released at full speed; negative: behind it."""
    speed, radius = robot.holder_for("a shot").limits.v, robot.scene.objects[BALL].radius
    return round(roll_of(robot) * speed * speed - radius, 2)


def roll_of(robot: Robot) -> float:
    """Return how far a ball is sent before it is let go, in m per (m/s)^2."""
    return _ROLL_SHARE / (2.0 * robot.scene.objects[BALL].rolling_deceleration)
