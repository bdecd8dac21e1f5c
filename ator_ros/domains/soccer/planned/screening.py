"""Rules out many manoeuvres at once, before single ones are checked exactly.

Where rounding could matter, a manoeuvre is not ruled out: the exact check decides (see `planner`).
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiles
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.goals import wall_distances
from ator_ros.domains.soccer.planned.clearance import STRIDE, Obstacles, ball_distances
from ator_ros.domains.soccer.planned.compiled_screening import (
    BACKWARD,
    DOUBT,
    Blocked,
    BundleArrays,
    Outline,
    judge,
    touch,
)
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.motion.bundle import Bundle, closed_bundle, courses
from ator_ros.motion.compiled_manoeuvre import End
from ator_ros.motion.durations import Rates, rates_of
from ator_ros.motion.trajectory import DT
from ator_ros.robot.description import Robot
from ator_ros.world.state import ObjectState

_SAMPLES = 32_000  # of trajectories, in a portion of work
_LARGEST = 64  # manoeuvres in a portion


class Verdict(enum.IntEnum):
    """The verdict on a manoeuvre: it is not allowed, or it touches something, or neither is known."""

    IMPOSSIBLE = 0
    TOUCHES = 1
    OPEN = 2


def portions(order: NDArray[np.intp], times: FloatArray) -> Iterator[NDArray[np.intp]]:
    """Divide the indices `order` into portions of about the same work, the first of a single one.

    `times` are the durations in s, ascending, of all manoeuvres that the indices are of.
    """
    size = 1
    while len(order):
        yield order[:size]
        order = order[size:]
        if len(order):
            size = max(2, min(16 * size, _LARGEST, int(_SAMPLES * DT / max(times[order[0]], DT))))


def look_points(duration: float) -> int:
    """Return the cost in points of the exact check of a manoeuvre of `duration` s; see `planning`."""
    return 15 + int(duration / 1.5)


def screening_points(durations: FloatArray) -> int:
    """Return the cost of screening manoeuvres of some `durations` (s), shape (n,)."""
    points = 4.0 + 0.2 * len(durations) + 0.02 * float(durations.sum())
    return int(points if compiles() else 8.0 * points)


def screened(
    bundle: Bundle, longest: FloatArray, obstacles: Obstacles, robot: Robot, *, forward_only: bool
) -> NDArray[np.int8]:
    """Judge manoeuvres before they are closed.

    Parameters
    ----------
    bundle : Bundle
        n manoeuvres.
    longest : ndarray, shape (n,)
        Greatest duration in s, once closed.

    Returns
    -------
    ndarray of int8, shape (n,)
        A `Verdict` each.
    """
    bundle, obstacles = _from_centre(bundle, obstacles, robot)
    if compiles():
        return judge(
            *_scalars(bundle), *_surroundings(obstacles, robot), np.ascontiguousarray(longest), forward_only
        )
    return screened_at_once(bundle, longest, obstacles, robot, forward_only=forward_only)


def touching(bundle: Bundle, obstacles: Obstacles, robot: Robot) -> BoolArray:
    """Return which closed manoeuvres certainly touch an obstacle; see `clearance.is_clear`."""
    bundle, obstacles = _from_centre(bundle, obstacles, robot)
    if compiles():
        return touch(*_scalars(bundle), *_surroundings(obstacles, robot))
    return touching_at_once(bundle, obstacles, robot)


def _from_centre(bundle: Bundle, obstacles: Obstacles, robot: Robot) -> tuple[Bundle, Obstacles]:
    """Return manoeuvres and obstacles with places relative to the centre of the area."""
    area, ball, start = robot.scene.area, obstacles.ball, bundle.start
    if area.x == area.y == 0.0:
        return bundle, obstacles
    moved = dataclasses.replace(
        bundle,
        start=start._replace(x=start.x - area.x, y=start.y - area.y),
        goals=bundle.goals - np.array([[area.x], [area.y], [0.0]]),
    )
    if ball is not None:
        ball = dataclasses.replace(ball, x=ball.x - area.x, y=ball.y - area.y)
    return moved, dataclasses.replace(obstacles, ball=ball)


def _scalars(bundle: Bundle) -> tuple[End, BundleArrays, Rates]:
    limits = bundle.limits
    columns = (bundle.goals, bundle.entries, bundle.exits, bundle.first, bundle.last, bundle.distance)
    return (
        End(*map(float, bundle.start)),
        BundleArrays(*(np.ascontiguousarray(column, dtype=float) for column in columns)),
        rates_of(limits),
    )


def _surroundings(obstacles: Obstacles, robot: Robot) -> tuple[Outline, Blocked]:
    field, ball = field_of(robot), obstacles.ball
    lengths = (
        robot.front, robot.rear, robot.half_width, robot.tip,
        robot.tip_half_width, robot.reach,
        field.walls_begin, field.goal_width / 2, field.goal_depth,
    )  # fmt: skip
    x, y = (np.nan, np.nan) if ball is None else (ball.x, ball.y)
    in_the_way = (x, y, robot.scene.radius(BALL), obstacles.ball_margin, obstacles.run)
    return Outline(*map(float, lengths)), Blocked(*map(float, in_the_way))


# Without numba, all manoeuvres at once: loops of Python would take too long.


def screened_at_once(
    bundle: Bundle, longest: FloatArray, obstacles: Obstacles, robot: Robot, *, forward_only: bool
) -> NDArray[np.int8]:
    """Return what `screened` does, without compiled code."""
    bundle, found = closed_bundle(bundle)
    speeds, _ = courses(bundle)
    duration = speeds.durations.sum(axis=1)
    possible, certain = duration < longest - DOUBT, np.abs(duration - longest) > DOUBT
    if forward_only:
        back = ((speeds.ends < BACKWARD - DOUBT) & (speeds.durations > DOUBT)).any(axis=1)
        hardly = ((speeds.ends < BACKWARD + DOUBT) & (speeds.durations > -DOUBT)).any(axis=1)
        possible &= ~back
        certain &= (back == hardly) | (duration > longest + DOUBT)
    certain &= found
    verdicts = np.where(certain & ~possible, Verdict.IMPOSSIBLE, Verdict.OPEN).astype(np.int8)
    valid = certain & possible
    if valid.any():
        verdicts[valid] -= touching_at_once(bundle.picked(valid), obstacles, robot)
    return verdicts


def touching_at_once(bundle: Bundle, obstacles: Obstacles, robot: Robot) -> BoolArray:
    """Return what `touching` does, without compiled code."""
    speeds, turns = courses(bundle)
    duration = speeds.durations.sum(axis=1)
    grid = DT * np.arange(int(duration.max() / DT) + 2)
    times = np.minimum(grid, duration[:, None])
    poses = _poses(bundle, times, speeds.at(times), turns.at(times))
    seen = grid[::STRIDE] < duration[:, None] - DOUBT
    touches = _near_walls(poses[:, :, ::STRIDE], seen, robot)
    if obstacles.ball is None:
        return touches
    if obstacles.run > 0.0:
        left = np.hypot(poses[0] - bundle.goals[0, :, None], poses[1] - bundle.goals[1, :, None])
        far = left > obstacles.run + DOUBT
        last = np.where(far.any(axis=1), far.shape[1] - 1 - np.argmax(far[:, ::-1], axis=1), -1)
        seen &= STRIDE * np.arange(seen.shape[1]) <= last[:, None]
    return touches | _near_ball(poses[:, :, ::STRIDE], seen, obstacles.ball, obstacles.ball_margin, robot)


def _poses(bundle: Bundle, times: FloatArray, speeds: FloatArray, turns: FloatArray) -> FloatArray:
    """Compute poses as `Trajectory` does, shape (3, n, times)."""
    start, goals, steps = bundle.start, bundle.goals[:, :, None], np.diff(times, axis=1)
    yaw = start.yaw + _summed(0.5 * (turns[:, :-1] + turns[:, 1:]) * steps)
    middle = 0.5 * (yaw[:, :-1] + yaw[:, 1:])
    travelled = 0.5 * (speeds[:, :-1] + speeds[:, 1:]) * steps
    poses = np.stack(
        (start.x + _summed(travelled * np.cos(middle)), start.y + _summed(travelled * np.sin(middle)), yaw)
    )
    errors = goals - poses[:, :, -1:]
    errors[2] = (errors[2] + np.pi) % (2.0 * np.pi) - np.pi
    poses += times / np.maximum(times[:, -1:], DT) * errors
    return poses


def _summed(steps: FloatArray) -> FloatArray:
    sums = np.zeros((len(steps), steps.shape[1] + 1))
    np.cumsum(steps, axis=1, out=sums[:, 1:])
    return sums


def _near_walls(poses: FloatArray, seen: BoolArray, robot: Robot) -> BoolArray:
    """Return which rows of poses, shape (3, n, m), have one that is `seen` and touches a goal's wall."""
    field = field_of(robot)
    near = seen & (np.abs(poses[0]) > field.walls_begin - robot.reach)
    distances = wall_distances(poses[:, near].T, field)
    return _in_rows(near, distances < robot.reach - DOUBT)


def _near_ball(
    poses: FloatArray, seen: BoolArray, ball: ObjectState, margin: float, robot: Robot
) -> BoolArray:
    body = np.hypot(max(robot.front, robot.rear), robot.half_width)
    reach = max(robot.reach, body) + robot.scene.radius(BALL) + margin
    near = seen & (np.abs(poses[0] - ball.x) < reach) & (np.abs(poses[1] - ball.y) < reach)
    return _in_rows(near, ball_distances(poses[:, near].T, ball, robot) < margin - DOUBT)


def _in_rows(places: BoolArray, hits: BoolArray) -> BoolArray:
    """Return which rows of `places` hold one of the `hits`, given for its true elements in order."""
    rows = np.zeros(len(places), dtype=bool)
    rows[np.nonzero(places)[0][hits]] = True
    return rows
