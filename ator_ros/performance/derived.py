"""Quantities derived from the direct variables: what features are made of (paper, section 4.1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import turn_time
from ator_ros.motion.shapes import fastest_paths
from ator_ros.performance.direct import (
    HOLD,
    SPEEDG,
    XG,
    YAW,
    YAWG,
    YG,
    Direct,
    V,
    W,
    X,
    Y,
    direct_table,
)
from ator_ros.performance.driving import DrivingStyle, plain_driving
from ator_ros.robot.description import Robot
from ator_ros.world.state import AT_REST

BASICS = (
    *("x", "y", "yaw", "xg", "yg", "yawg", "dx", "dy", "dist", "angle_to_dest", "angle_at_dest"),
    *("angle_at_dest_by_turn", "angle_between", "v", "w_by_turn", "speedg", "hold"),
)
"""Names of the features that the first rows hold, see `ator_ros.performance.features`."""
FROM_X, FROM_Y, FROM_YAW, GOAL_X, GOAL_Y, GOAL_YAW, DX, DY, DIST, ANGLE_TO, ANGLE_AT = range(11)
AT_BY_TURN, ANGLE_BETWEEN, SPEED, W_BY_TURN, ARRIVAL, HOLDS = range(11, len(BASICS))
TO_X, TO_Y, TO_DEST, AT_DEST, RESTS, OPENING = range(len(BASICS), len(BASICS) + 6)
"""Rows after them: the destination (m), the signed angles to and at it (rad), whether the robot stands at
both ends (1 or 0), and four of the end of the opening: x, y (m), heading (rad), and its time (s)."""
ENDS = OPENING + 4  # five rows: both ends of the path after the opening, see `fastest_paths`
PATH_TIME, PATH_TURN = ENDS + 5, ENDS + 6  # s, rad; `Geometry.path` writes them
ROWS = PATH_TURN + 1
_REST_V, _REST_W = AT_REST.v, AT_REST.w


@compiled
def wrapped(angle: float) -> float:
    """Return the same angle in rad in [-pi, pi), as `ator_ros.geometry.wrap_angles` does."""
    turned = angle + math.pi
    if not 0.0 <= turned < 2.0 * math.pi:  # usually it is, and the remainder is slow
        turned %= 2.0 * math.pi
    return turned - math.pi


NEAR = 0.04
"""Distance in m from the goal within which a robot at rest only has to turn to the goal's heading."""
# weight of the goal's heading in the bearing of a goal within `NEAR`, which is noise
_NEAR_PULL = 20.0

# The direct variables `direct` have the shape (10 or more, n), `rows` has the shape (ROWS, n).


@compiled
def _write_rows(direct: FloatArray, hold: float, aw: float, rows: FloatArray) -> None:
    """Write all rows but those of the path; `hold` in m.

    In the opening the robot loses its rotation at up to `aw` (rad/s^2), while its speed stays the
    same.
    """
    for at in range(direct.shape[1]):
        speed, rotation, yaw = direct[V, at], direct[W, at], direct[YAW, at]
        from_x, from_y, heading = direct[X, at], direct[Y, at], direct[YAWG, at]
        rows[FROM_X, at], rows[FROM_Y, at], rows[FROM_YAW, at] = from_x, from_y, yaw
        rows[GOAL_X, at], rows[GOAL_Y, at], rows[GOAL_YAW, at] = (
            direct[XG, at],
            direct[YG, at],
            heading,
        )
        cos, sin = math.cos(heading), math.sin(heading)
        back = hold * direct[HOLD, at]
        x, y = direct[XG, at] - back * cos, direct[YG, at] - back * sin
        dx, dy = x - from_x, y - from_y
        dist = math.sqrt(dx * dx + dy * dy)
        rows[TO_X, at], rows[TO_Y, at], rows[DX, at], rows[DY, at], rows[DIST, at] = (
            x,
            y,
            dx,
            dy,
            dist,
        )
        pull = _NEAR_PULL * max(NEAR - dist, 0.0)
        bearing = math.atan2(dy + pull * sin, dx + pull * cos)
        to, there = wrapped(bearing - yaw), wrapped(heading - bearing)
        side = 1.0 if to >= 0.0 else -1.0
        rows[TO_DEST, at], rows[AT_DEST, at] = to, there
        rows[ANGLE_TO, at], rows[ANGLE_AT, at] = abs(to), abs(there)
        rows[AT_BY_TURN, at], rows[W_BY_TURN, at] = side * there, side * rotation
        rows[ANGLE_BETWEEN, at] = abs(wrapped(heading - yaw))
        arrival = direct[SPEEDG, at]
        rows[SPEED, at], rows[ARRIVAL, at], rows[HOLDS, at] = speed, arrival, direct[HOLD, at]
        rows[RESTS, at] = abs(speed) <= _REST_V and abs(rotation) <= _REST_W and arrival <= _REST_V
        time = abs(rotation) * (1.0 / aw)
        half = 0.5 * rotation * time
        mean = yaw + (2.0 / 3.0) * half
        distance = speed * time
        opened_x, opened_y = from_x + distance * math.cos(mean), from_y + distance * math.sin(mean)
        opened_yaw = yaw + half
        rows[OPENING, at], rows[OPENING + 1, at] = opened_x, opened_y
        rows[OPENING + 2, at], rows[OPENING + 3, at] = opened_yaw, time
        dx, dy, cos, sin = x - opened_x, y - opened_y, math.cos(opened_yaw), math.sin(opened_yaw)
        rows[ENDS, at], rows[ENDS + 1, at] = cos * dx + sin * dy, cos * dy - sin * dx
        rows[ENDS + 2, at] = wrapped(heading - opened_yaw)
        rows[ENDS + 3, at], rows[ENDS + 4, at] = speed, arrival


ALIGNED = 0.1
"""Angle in rad up to which a robot may turn on the spot with an object in front."""


@compiled
def _write_paths(rows: FloatArray, paths: FloatArray, w: float, aw: float) -> None:
    """Write the paths with their openings; `paths`, shape (2, n), are those after the openings.

    A robot at rest within `NEAR` of its goal turns on the spot, with an object in front up to
    `ALIGNED` only, at rates up to `w` (rad/s) and `aw` (rad/s^2).
    """
    for at in range(rows.shape[1]):
        rows[PATH_TIME, at], rows[PATH_TURN, at] = (
            paths[0, at] + rows[OPENING + 3, at],
            paths[1, at],
        )
        angle = rows[ANGLE_BETWEEN, at]
        free = rows[HOLDS, at] < 0.5 or angle <= ALIGNED
        if free and rows[RESTS, at] > 0.5 and rows[DIST, at] < NEAR:
            rows[PATH_TIME, at], rows[PATH_TURN, at] = turn_time(angle, w, aw), angle


Derived = TypeVar("Derived")


class Geometry:
    """The derived quantities of n situations, each computed once, when it is first requested.

    Parameters
    ----------
    direct, further
        Direct variables, see `direct_table`.
    driving : DrivingStyle, optional
        How the action was observed to drive; by default at all limits of the base.
    """

    def __init__(
        self,
        direct: Direct,
        robot: Robot,
        driving: DrivingStyle | None = None,
        further: Iterable[str] = (),
    ) -> None:
        self.direct = direct_table(direct, further)
        self._table = self.direct.table
        self.robot, self._driving = robot, driving
        self._kept: dict[Callable[[Geometry], Any], Any] = {}

    def once(self, compute: Callable[[Geometry], Derived]) -> Derived:
        """Return the result of `compute` for this geometry, which is called once."""
        if compute not in self._kept:
            self._kept[compute] = compute(self)
        kept: Derived = self._kept[compute]
        return kept

    @property
    def backward_above(self) -> float:
        """Angle in rad to the destination above which the action drives backward."""
        return math.pi if self._driving is None else self._driving.backward_above

    @cached_property
    def rows(self) -> FloatArray:
        """The quantities of `BASICS` and those after them, shape (ROWS, n).

        `path` writes its own.
        """
        rows = np.empty((ROWS, self._table.shape[1]))
        _write_rows(self._table, self.robot.hold, self.robot.limits.aw, rows)
        return rows

    def selected(self, numbers: Sequence[int]) -> FloatArray:
        """Return the rows with these numbers, shape (len(numbers), n)."""
        if max(numbers) >= PATH_TIME:
            _ = self.path  # writes its rows
        return self.rows.take(numbers, axis=0)

    @property
    def dist(self) -> FloatArray:
        """Distance from start to destination in m."""
        return np.asarray(self.rows[DIST])

    @property
    def to_dest(self) -> FloatArray:
        """Signed angle in rad from the heading to the destination's bearing."""
        return np.asarray(self.rows[TO_DEST])

    @property
    def at_dest(self) -> FloatArray:
        """Signed angle in rad from the destination's bearing to the heading there."""
        return np.asarray(self.rows[AT_DEST])

    @property
    def ends(self) -> FloatArray:
        """Both ends of the path after the opening, see `ator_ros.motion.shapes.fastest_paths`."""
        return self.rows[ENDS:PATH_TIME]

    @cached_property
    def path(self) -> FloatArray:
        """Times (s) of, and angles (rad) turned on, the fastest paths as the action drives, shape (2, n)."""
        driving = self._driving or plain_driving(self.robot)
        holding = self.rows[HOLDS] > 0.5
        held = np.count_nonzero(holding)
        hold, shapes = (
            (self.robot.hold, driving.approach_paths) if held else (0.0, driving.drive_paths)
        )
        paths = fastest_paths(self.ends, shapes, hold=hold)
        if driving.approaches and 0 < held < len(holding):
            paths = np.where(
                holding, paths, fastest_paths(self.ends, driving.drive_paths, hold=hold)
            )
        _write_paths(self.rows, paths, driving.limits.w, driving.limits.aw)
        return self.rows[PATH_TIME:]


def from_hold(geometry: Geometry) -> tuple[FloatArray, FloatArray]:
    """Return distance in m and bearing in rad of the goal's position, from the hold at the start."""
    d, hold = geometry.direct, geometry.robot.hold
    dx = d["xg"] - d["x"] - hold * np.cos(d["yaw"])
    dy = d["yg"] - d["y"] - hold * np.sin(d["yaw"])
    return np.sqrt(dx * dx + dy * dy), np.arctan2(dy, dx)
