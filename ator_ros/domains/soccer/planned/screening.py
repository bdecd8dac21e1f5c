"""Rules out many manoeuvres at once, before single ones are checked exactly.

Where rounding could matter, a manoeuvre is not ruled out: the exact check decides (see `planner`).
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.field import field_of
from ator_ros.domains.soccer.planned.clearance import Obstacles
from ator_ros.domains.soccer.planned.compiled_screening import (
    Blocked,
    BundleArrays,
    Outline,
    judge,
    touch,
)
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.motion.compiled_manoeuvre import End
from ator_ros.motion.durations import Rates, rates_of
from ator_ros.motion.manoeuvre import Bundle
from ator_ros.motion.trajectory import DT
from ator_ros.robot.description import Robot

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
    return int(4.0 + 0.2 * len(durations) + 0.02 * float(durations.sum()))


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
    return judge(
        *_scalars(bundle), *_surroundings(obstacles, robot), np.ascontiguousarray(longest), forward_only
    )


def touching(bundle: Bundle, obstacles: Obstacles, robot: Robot) -> BoolArray:
    """Return which closed manoeuvres certainly touch an obstacle; see `clearance.is_clear`."""
    bundle, obstacles = _from_centre(bundle, obstacles, robot)
    return touch(*_scalars(bundle), *_surroundings(obstacles, robot))


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
