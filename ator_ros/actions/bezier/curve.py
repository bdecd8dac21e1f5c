"""Bezier curves between poses, many at once: shape, time to drive them, and what they run into."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ator_ros.geometry import FloatArray, Pose, wrap_angles
from ator_ros.robot import Robot
from ator_ros.world import Field

SAMPLES = 25
TAIL_SAMPLES = 6
"""Points of the way from the end of a curve to the goal."""

_T = np.linspace(0.0, 1.0, SAMPLES)
# Bernstein polynomials of the cubic, and of the middle control point that the bump adds in degree four.
_CUBIC = np.stack([(1 - _T) ** 3, 3 * _T * (1 - _T) ** 2, 3 * _T**2 * (1 - _T), _T**3], axis=1)
_BODY = 0.36
_WALL_ROOM = 0.08
_BUMP = 6 * _T**2 * (1 - _T) ** 2


@dataclass(frozen=True, slots=True)
class Paths:
    """Paths as polylines, one a row; a corner stands for a turn on the spot.

    Attributes
    ----------
    points : array, shape (n, m + 1, 2)
        Positions in m.
    lengths : array, shape (n, m)
        Length of each segment in m.
    headings : array, shape (n, m)
        Direction of each segment in rad.
    turns : array, shape (n, m)
        Change of direction in rad where each segment begins, from the start's heading for the first.
    last_turn : array, shape (n,)
        Change of direction in rad from the last segment to the end's heading.
    """

    points: FloatArray
    lengths: FloatArray
    headings: FloatArray
    turns: FloatArray
    last_turn: FloatArray

    def row(self, index: int) -> Paths:
        """Give one path as a set of its own."""
        at = slice(index, index + 1)
        return Paths(self.points[at], self.lengths[at], self.headings[at], self.turns[at], self.last_turn[at])


def bezier_paths(
    starts: FloatArray,
    ends: FloatArray,
    handles: FloatArray,
    bumps: FloatArray,
    tails: FloatArray,
    yaw: FloatArray,
) -> Paths:
    """Lay a Bezier curve from each start to its end, and its tail behind it.

    Parameters
    ----------
    starts, ends : array, shape (n, 3)
        Poses (x, y, yaw) in m and rad.
    handles : array, shape (n, 2)
        Distance in m from the first control point to the second, and from the third to the last.
    bumps : array, shape (n,)
        How far in m a further control point pulls the curve's middle to the left of start to end.
    tails : array, shape (n, TAIL_SAMPLES, 2)
        Points in m that lead from each end to the goal, the end itself excluded.
    yaw : array, shape (n,)
        Heading at the goal in rad.
    """
    out, into = _directions(starts[:, 2]), _directions(ends[:, 2])
    first, last = starts[:, :2], ends[:, :2]
    second = first + handles[:, :1] * out
    third = last - handles[:, 1:] * into
    points = np.einsum("tk,nkd->ntd", _CUBIC, np.stack([first, second, third, last], axis=1))
    points += _BUMP[None, :, None] * bumps[:, None, None] * left_of(last - first, into)[:, None, :]
    points = np.concatenate([points, tails], axis=1)
    steps = np.diff(points, axis=1)
    headings = np.arctan2(steps[..., 1], steps[..., 0])
    turns = wrap_angles(np.diff(headings, axis=1, prepend=starts[:, 2:]))
    last_turn = wrap_angles(yaw - headings[:, -1])
    return Paths(points, np.hypot(steps[..., 0], steps[..., 1]), headings, turns, last_turn)


def _directions(yaw: FloatArray) -> FloatArray:
    return np.stack([np.cos(yaw), np.sin(yaw)], axis=1)


def left_of(chord: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Give the unit vector to the left of each chord, or of `otherwise` where the chord is short."""
    length = np.hypot(chord[:, 0], chord[:, 1])[:, None]
    ahead = np.where(length > 0.1, chord / np.maximum(length, 0.1), otherwise)
    return np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)


def drive_time(paths: Paths, *, v: float, w: float) -> FloatArray:
    """Give the time in s to drive each path at no more than v (m/s) and w (rad/s), shape (n,)."""
    turning = np.abs(paths.turns)
    shared = turning.copy()
    shared[:, :-1] = (turning[:, :-1] + turning[:, 1:]) / 2
    shared[:, 0] += turning[:, 0] / 2
    times = np.maximum(paths.lengths / v, shared / w)
    return np.asarray(times.sum(axis=1) + np.abs(paths.last_turn) / w)


def sharpness(paths: Paths, *, radius: float) -> FloatArray:
    """Give the angle in rad, shape (n,), by which each path turns more than arcs of `radius` m would."""
    room = (paths.lengths[:, 1:] + paths.lengths[:, :-1]) / (2 * radius)
    return np.asarray(np.maximum(np.abs(paths.turns[:, 1:]) - room, 0.0).sum(axis=1))


def length_outside(paths: Paths, robot: Robot, *, with_ball: bool) -> FloatArray:
    """Give the length in m of each path, shape (n,), that is off the floor or too near to a goal's walls.

    Parameters
    ----------
    paths : Paths
        Paths of the axle, driven forward.
    robot : Robot
        The shape that moves, and the field.
    with_ball : bool
        Whether a ball lies in front, which must not meet a wall either.
    """
    field = robot.field
    points = paths.points[:, 1:]
    x, y = np.abs(points[..., 0]), np.abs(points[..., 1])
    outside = (x > field.length / 2 + field.margin - robot.rear) | (y > field.width / 2 + field.margin / 2)
    outside |= _at_wall(points, field, _BODY)
    if with_ball:
        ahead = np.stack([np.cos(paths.headings), np.sin(paths.headings)], axis=-1)
        outside |= _at_wall(points + robot.hold * ahead, field, robot.ball.radius + _WALL_ROOM)
    return np.asarray((outside * paths.lengths).sum(axis=1))


def _at_wall(points: FloatArray, field: Field, radius: float) -> NDArray[np.bool_]:
    """Say which points (m, shape (..., 2)) are within `radius` (m) of a goal's side walls, or deep in it."""
    x, y = np.abs(points[..., 0]), np.abs(points[..., 1])
    line, half = field.length / 2, field.goal_width / 2
    return np.asarray((x > line - radius) & (np.abs(y - half) < radius) | ((x > line) & (y < half)))


def length_touching(
    paths: Paths, robot: Robot, ball: tuple[float, float], *, clearance: float, slack: float
) -> FloatArray:
    """Give the length in m of each path, shape (n,), on which the robot would push the ball.

    Parameters
    ----------
    paths : Paths
        Paths of the axle, driven forward.
    robot : Robot
        The shape that moves.
    ball : tuple of float
        Position in m.
    clearance : float
        Distance in m to keep.
    slack : float
        A ball is not pushed but taken in when it lies before the front and no farther to a side, in m.
    """
    middle = (paths.points[:, 1:] + paths.points[:, :-1]) / 2
    dx, dy = ball[0] - middle[..., 0], ball[1] - middle[..., 1]
    c, s = np.cos(paths.headings), np.sin(paths.headings)
    ahead, aside = c * dx + s * dy, np.abs(c * dy - s * dx)
    room = robot.ball.radius + clearance
    touches = (
        (aside < robot.half_width + room)
        & (ahead > -robot.rear - room)
        & (ahead < robot.front + robot.fin_length + room)
        & ~((aside < slack) & (ahead > robot.hold - 0.02))
    )
    return np.asarray((touches * paths.lengths).sum(axis=1))


def as_row(pose: Pose) -> FloatArray:
    """Give a pose as an array, shape (3,)."""
    return np.array([pose.x, pose.y, pose.yaw])
