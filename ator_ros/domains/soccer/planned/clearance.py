"""Keeps planned manoeuvres clear of the ball and of the goals' walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ator_ros.domains.soccer.field import BALL, touches_goals
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.manoeuvre import Manoeuvre
from ator_ros.motion.trajectory import Trajectory
from ator_ros.robot.description import Robot
from ator_ros.world.state import ObjectState

STRIDE = 5
"""Every how many samples of a trajectory are looked at: every 50 ms, 6 cm at full speed."""

_CLEARING = np.arange(0.0, 1.5, 0.01)
"""Lengths in m of straight drives that may lead away from a ball."""


@dataclass(frozen=True, slots=True)
class Obstacles:
    """What a motion must not touch.

    Attributes
    ----------
    ball : ObjectState or None
        The ball, taken as standing still.
    ball_margin : float
        Free distance to keep from the ball in m.
    run : float
        Straight stretch at the end in m in which the ball may be touched, since it is what is approached.
    """

    ball: ObjectState | None = None
    ball_margin: float = 0.04
    run: float = 0.0


def is_clear(manoeuvre: Manoeuvre, obstacles: Obstacles, robot: Robot) -> bool:
    """Return whether the robot touches no obstacle on the way."""
    poses = Trajectory(manoeuvre).poses()
    if touches_goals(poses[::STRIDE], robot):
        return False
    ball = obstacles.ball
    if ball is None:
        return True
    if obstacles.run > 0.0:
        # In the run the ball lies straight ahead; a little more than that decides nothing.
        far = np.hypot(poses[:, 0] - manoeuvre.goal.x, poses[:, 1] - manoeuvre.goal.y) > obstacles.run
        last = int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0
        poses = poses[:last]
    return not bool(np.any(ball_distances(poses[::STRIDE], ball, robot) < obstacles.ball_margin))


def is_free(start: Pose, goal: Pose, obstacles: Obstacles, robot: Robot) -> bool:
    """Return whether the robot touches no obstacle at the start; otherwise no motion to `goal` is clear."""
    pose, ball = np.array([start]), obstacles.ball
    if touches_goals(pose, robot):
        return False
    if ball is None or start.distance(goal) <= obstacles.run:
        return True
    return bool(ball_distances(pose, ball, robot)[0] >= obstacles.ball_margin)


def distance_to_clear(start: Pose, goal: Pose, obstacles: Obstacles, robot: Robot) -> float:
    """Return how far to drive straight until the robot keeps its margin from the ball.

    Returns
    -------
    float
        Signed distance in m, negative: backward. 0 if the robot is clear at the start, or if no straight
        drive clears it without coming nearer to the ball or touching a goal.
    """
    ball = obstacles.ball
    if ball is None or is_free(start, goal, obstacles, robot) or touches_goals(np.array([start]), robot):
        return 0.0
    found = []
    for sign in (-1.0, 1.0):
        ways = sign * _CLEARING
        poses = np.array([start.ahead(way) for way in ways])
        distances = ball_distances(poses, ball, robot)
        clear = np.flatnonzero(distances >= obstacles.ball_margin)
        if not len(clear):
            continue
        last = int(clear[0])
        nearer = distances[: last + 1].min() < distances[0] - 1e-9
        if not nearer and not touches_goals(poses[: last + 1], robot):
            found.append(float(ways[last]))
    return min(found, key=abs, default=0.0)


def ball_distances(poses: FloatArray, ball: ObjectState, robot: Robot) -> FloatArray:
    """Return the free distance between the robot at each pose and the ball.

    Parameters
    ----------
    poses : ndarray, shape (n, 3)
        x, y in m, yaw in rad.

    Returns
    -------
    ndarray, shape (n,)
        Distance in m from the ball's surface to the robot's outline; negative where they overlap.
    """
    dx, dy = ball.x - poses[:, 0], ball.y - poses[:, 1]
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    ahead, left = c * dx + s * dy, np.abs(c * dy - s * dx)
    body = _box_distance(ahead, left, -robot.rear, robot.front, robot.half_width)
    front = _box_distance(ahead, left, robot.front, robot.tip, robot.tip_half_width)
    return np.asarray(np.minimum(body, front) - robot.scene.radius(BALL))


def _box_distance(x: FloatArray, y: FloatArray, low: float, high: float, half: float) -> FloatArray:
    return np.hypot(np.maximum(np.maximum(low - x, x - high), 0.0), np.maximum(y - half, 0.0))
