"""Quantities derived from the direct variables: what features are made of (paper, section 4.1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.bases.differential.description import differential
from ator_ros.bases.differential.durations import turn_time
from ator_ros.bases.differential.shapes import fastest_paths
from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
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
from ator_ros.world.state import AT_REST

BASICS = (
    "x",
    "y",
    "yaw",
    "xg",
    "yg",
    "yawg",
    "dx",
    "dy",
    "dist",
    "angle_to_dest",
    "angle_at_dest",
    "angle_at_dest_by_turn",
    "angle_between",
    "v",
    "w_by_turn",
    "speedg",
    "hold",
)
"""Names of the features that the first rows hold, see `ator_ros.performance.features`."""
(FROM_X, FROM_Y, FROM_YAW, GOAL_X, GOAL_Y, GOAL_YAW, DX, DY, DIST, ANGLE_TO, ANGLE_AT) = range(11)
AT_BY_TURN, ANGLE_BETWEEN, SPEED, W_BY_TURN, ARRIVAL, HOLDS = range(11, len(BASICS))
TO_X, TO_Y, TO_DEST, AT_DEST, RESTS, OPENING = range(len(BASICS), len(BASICS) + 6)
"""Numbers of the rows after those of `BASICS`.

The destination (m), the signed angles to it and at it (rad), whether the robot stands at both ends
(1 or 0), and four rows for the end of the opening: x and y (m), heading (rad), and its time (s).
"""
ENDS = OPENING + 4  # five rows: both ends of the path after the opening, see `fastest_paths`
PATH_TIME = ENDS + 5  # s; `Geometry.path` writes this row and the next
PATH_TURN = ENDS + 6  # rad
ROWS = PATH_TURN + 1
_REST_V = AT_REST.v
_REST_W = AT_REST.w


@compiled
def wrapped(angle: float) -> float:
    """Return the same angle in [-pi, pi), in rad.

    The result is that of `ator_ros.geometry.wrap_angles`.
    """
    turned = angle + math.pi
    if not 0.0 <= turned < 2.0 * math.pi:  # usually it is, and the remainder is slow
        turned %= 2.0 * math.pi
    return turned - math.pi


NEAR = 0.04
"""Distance in m from the goal within which a robot at rest only turns to the goal's heading."""
# Weight of the goal's heading in the bearing of a goal within `NEAR`. That bearing is noise:
# without the weight, path times were 3.8 s at any turn.
_NEAR_PULL = 20.0

# The direct variables `direct` have the shape (10 or more, n), `rows` has the shape (ROWS, n).


@compiled
def _write_rows(
    direct: FloatArray,
    hold: float,
    aw: float,
    rows: FloatArray,
) -> None:
    """Write all rows but those of the path; `hold` in m.

    In the opening the robot loses its rotation at up to `aw` (rad/s^2), while its speed stays the
    same.
    """
    for at in range(direct.shape[1]):
        speed = direct[V, at]
        rotation = direct[W, at]
        yaw = direct[YAW, at]
        from_x = direct[X, at]
        from_y = direct[Y, at]
        heading = direct[YAWG, at]
        rows[FROM_X, at] = from_x
        rows[FROM_Y, at] = from_y
        rows[FROM_YAW, at] = yaw
        rows[GOAL_X, at] = direct[XG, at]
        rows[GOAL_Y, at] = direct[YG, at]
        rows[GOAL_YAW, at] = heading
        cos = math.cos(heading)
        sin = math.sin(heading)
        back = hold * direct[HOLD, at]
        x = direct[XG, at] - back * cos
        y = direct[YG, at] - back * sin
        dx = x - from_x
        dy = y - from_y
        dist = math.sqrt(dx * dx + dy * dy)
        rows[TO_X, at] = x
        rows[TO_Y, at] = y
        rows[DX, at] = dx
        rows[DY, at] = dy
        rows[DIST, at] = dist
        pull = _NEAR_PULL * max(NEAR - dist, 0.0)
        bearing = math.atan2(dy + pull * sin, dx + pull * cos)
        to = wrapped(bearing - yaw)
        there = wrapped(heading - bearing)
        side = 1.0 if to >= 0.0 else -1.0
        rows[TO_DEST, at] = to
        rows[AT_DEST, at] = there
        rows[ANGLE_TO, at] = abs(to)
        rows[ANGLE_AT, at] = abs(there)
        rows[AT_BY_TURN, at] = side * there
        rows[W_BY_TURN, at] = side * rotation
        rows[ANGLE_BETWEEN, at] = abs(wrapped(heading - yaw))
        arrival = direct[SPEEDG, at]
        rows[SPEED, at] = speed
        rows[ARRIVAL, at] = arrival
        rows[HOLDS, at] = direct[HOLD, at]
        starts_at_rest = abs(speed) <= _REST_V and abs(rotation) <= _REST_W
        rows[RESTS, at] = starts_at_rest and arrival <= _REST_V
        time = abs(rotation) * (1.0 / aw)
        half = 0.5 * rotation * time
        mean = yaw + (2.0 / 3.0) * half
        distance = speed * time
        opened_x = from_x + distance * math.cos(mean)
        opened_y = from_y + distance * math.sin(mean)
        opened_yaw = yaw + half
        rows[OPENING, at] = opened_x
        rows[OPENING + 1, at] = opened_y
        rows[OPENING + 2, at] = opened_yaw
        rows[OPENING + 3, at] = time
        dx = x - opened_x
        dy = y - opened_y
        cos = math.cos(opened_yaw)
        sin = math.sin(opened_yaw)
        rows[ENDS, at] = cos * dx + sin * dy
        rows[ENDS + 1, at] = cos * dy - sin * dx
        rows[ENDS + 2, at] = wrapped(heading - opened_yaw)
        rows[ENDS + 3, at] = speed
        rows[ENDS + 4, at] = arrival


ALIGNED = 0.1
"""Angle in rad up to which a robot may turn on the spot with an object in front."""


@compiled
def _write_paths(
    rows: FloatArray,
    paths: FloatArray,
    w: float,
    aw: float,
) -> None:
    """Write the paths with their openings; `paths`, shape (2, n), are those after the openings.

    A robot at rest within `NEAR` of its goal turns on the spot, with an object in front up to
    `ALIGNED` only, at rates up to `w` (rad/s) and `aw` (rad/s^2).
    """
    for at in range(rows.shape[1]):
        rows[PATH_TIME, at] = paths[0, at] + rows[OPENING + 3, at]
        rows[PATH_TURN, at] = paths[1, at]
        angle = rows[ANGLE_BETWEEN, at]
        free = rows[HOLDS, at] < 0.5 or angle <= ALIGNED
        if free and rows[RESTS, at] > 0.5 and rows[DIST, at] < NEAR:
            rows[PATH_TIME, at] = turn_time(angle, w, aw)
            rows[PATH_TURN, at] = angle


Derived = TypeVar("Derived")


class Geometry:
    """The derived quantities of n situations (paper, section 4.1).

    Each is computed once, when it is first requested.

    Parameters
    ----------
    direct : mapping
        Direct variables, see `direct_table`.
    robot : Robot
        The robot that drives.
    driving : DrivingStyle, optional
        How the action was observed to drive; by default at all limits of the base.
    further : iterable of str
        Names of goal variables that are required besides.

    Raises
    ------
    ValueError
        A direct variable is missing.
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
        self.robot = robot
        self._driving = driving
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
        _write_rows(
            self._table,
            self.robot.hold,
            differential(self.robot).limits.aw,
            rows,
        )
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
        """Both ends of the path after the opening, see `ator_ros.bases.differential.shapes.fastest_paths`."""
        return self.rows[ENDS:PATH_TIME]

    @cached_property
    def path(self) -> FloatArray:
        """Times (s) of the fastest paths, and angles (rad) turned on them, shape (2, n).

        The paths are those that the action was observed to drive, including their openings.
        """
        driving = self._driving or plain_driving(self.robot)
        holding = self.rows[HOLDS] > 0.5
        held = np.count_nonzero(holding)
        hold = self.robot.hold if held else 0.0
        shapes = driving.approach_paths if held else driving.drive_paths
        paths = fastest_paths(self.ends, shapes, hold=hold)
        if driving.approaches and 0 < held < len(holding):
            drives = fastest_paths(self.ends, driving.drive_paths, hold=hold)
            paths = np.where(holding, paths, drives)
        _write_paths(self.rows, paths, driving.limits.w, driving.limits.aw)
        return self.rows[PATH_TIME:]


def from_hold(geometry: Geometry) -> tuple[FloatArray, FloatArray]:
    """Return distance (m) and bearing (rad) from the hold at the start to the goal's position.

    Both have the shape (n,). The bearing is in the world frame.
    """
    d = geometry.direct
    hold = geometry.robot.hold
    dx = d["xg"] - d["x"] - hold * np.cos(d["yaw"])
    dy = d["yg"] - d["y"] - hold * np.sin(d["yaw"])
    return np.sqrt(dx * dx + dy * dy), np.arctan2(dy, dx)
