"""Quantities derived from the direct variables: what features are made of (paper, section 4.1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ator_ros.actions.goal_variables import STOP, direct_name
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import (
    HOLD,
    NEAR,
    SPEEDG,
    VY,
    XG,
    YAW,
    YAWG,
    YG,
    Direct,
    DirectTable,
    V,
    W,
    X,
    Y,
    direct_table,
    wrapped,
)
from ator_ros.bases.interface import Driving
from ator_ros.bases.routes import routes_of
from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
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
    "vy_by_turn",
)
"""Names of the features that the first rows hold, see `ator_ros.performance.features`."""
(FROM_X, FROM_Y, FROM_YAW, GOAL_X, GOAL_Y, GOAL_YAW, DX, DY, DIST, ANGLE_TO, ANGLE_AT) = range(11)
AT_BY_TURN, ANGLE_BETWEEN, SPEED, W_BY_TURN, ARRIVAL, HOLDS, VY_BY_TURN = range(11, len(BASICS))
TO_X, TO_Y, TO_DEST, AT_DEST, RESTS, PATH_TIME, PATH_TURN = range(len(BASICS), len(BASICS) + 7)
"""Numbers of the rows after those of `BASICS`.

The destination (m), the signed angles to it and at it (rad), whether the robot stands at both ends
(1 or 0), and time (s) and turned angle (rad) of the path, which `Geometry.path` writes.
"""
ROWS = PATH_TURN + 1
_REST_V = AT_REST.speed
_REST_W = AT_REST.w


# Weight of the goal's heading in the bearing of a goal within `NEAR`. That bearing is noise:
# without the weight, path times were 3.8 s at any turn.
_NEAR_PULL = 20.0

# The direct variables `direct` have the shape (10 or more, n), `rows` has the shape (ROWS, n).


@compiled
def _write_rows(
    direct: FloatArray,
    hold: float,
    rows: FloatArray,
) -> None:
    """Write all rows but those of the path; `hold` in m."""
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
        rows[VY_BY_TURN, at] = side * direct[VY, at]
        rows[ANGLE_BETWEEN, at] = abs(wrapped(heading - yaw))
        arrival = direct[SPEEDG, at]
        rows[SPEED, at] = speed
        rows[ARRIVAL, at] = arrival
        rows[HOLDS, at] = direct[HOLD, at]
        starts_at_rest = (
            abs(speed) <= _REST_V and abs(direct[VY, at]) <= _REST_V and abs(rotation) <= _REST_W
        )
        rows[RESTS, at] = starts_at_rest and arrival <= _REST_V


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
    driving : Driving, optional
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
        driving: Driving | None = None,
        further: Iterable[str] = (),
    ) -> None:
        self.direct = _headed(direct_table(direct, further), robot)
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

    @cached_property
    def quantities(self) -> FloatArray:
        """The quantities of drives that the base adds, shape (k, n), see `Driving.quantities`."""
        driving = self._driving or self.robot.unobserved_driving()
        return driving.values(self.dist, self.rows[ANGLE_TO], self.rows[ANGLE_AT])

    @cached_property
    def rows(self) -> FloatArray:
        """The quantities of `BASICS` and those after them, shape (ROWS, n).

        `path` writes its own.
        """
        rows = np.empty((ROWS, self._table.shape[1]))
        _write_rows(
            self._table,
            self.robot.hold,
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

    @cached_property
    def path(self) -> FloatArray:
        """Times (s) of the fastest paths, and angles (rad) turned on them, shape (2, n).

        The paths are those that the action was observed to drive.
        """
        self.rows[PATH_TIME:] = self.robot.fastest(self._table, self._driving)
        return self.rows[PATH_TIME:]


_STOPG = direct_name(STOP)


def _headed(direct: DirectTable, robot: Robot) -> DirectTable:
    """Return direct variables in which the robot looks along its way where it passes its goal."""
    if _STOPG not in direct.names:
        return direct
    passing = direct[_STOPG] == 0.0
    if not passing.any():
        return direct
    table = direct.table.copy()
    x, y, to_x, to_y = table[np.ix_((X, Y, XG, YG), passing)]
    bearing = np.arctan2(to_y - y, to_x - x)
    routes = routes_of(robot)
    if routes is not None:
        route = routes.between(x, y, to_x, to_y)
        has_bends = ~route.straight & np.isfinite(route.arrival)  # there may be no route
        bearing = np.where(has_bends, route.arrival, bearing)
    table[YAWG, passing] = bearing
    return DirectTable(direct.names, table)


def from_hold(geometry: Geometry) -> tuple[FloatArray, FloatArray]:
    """Return distance (m) and bearing (rad) from the hold at the start to the goal's position.

    Both have the shape (n,). The bearing is in the world frame.
    """
    d = geometry.direct
    hold = geometry.robot.hold
    dx = d["xg"] - d["x"] - hold * np.cos(d["yaw"])
    dy = d["yg"] - d["y"] - hold * np.sin(d["yaw"])
    return np.sqrt(dx * dx + dy * dy), np.arctan2(dy, dx)
