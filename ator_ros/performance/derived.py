"""Quantities derived from the direct variables: what features are made of (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray, wrap_angles
from ator_ros.motion.durations import drive_time, rates_of, turn_time
from ator_ros.motion.families import Family, Motions, fastest_motions
from ator_ros.performance.compiled_geometry import (
    ANGLE_BETWEEN,
    AT_DEST,
    DIST,
    DX,
    DY,
    OPENING,
    ROWS,
    TO_DEST,
    TO_X,
    TO_Y,
    derive_angles,
    derive_ways,
    see_ends,
)
from ator_ros.performance.direct import Direct, V, direct_table
from ator_ros.performance.driving import DrivingStyle, plain_driving
from ator_ros.performance.paths import path_times
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import AT_REST

NEAR = 0.04
"""Distance in m from the goal within which a robot at rest only has to turn to the goal's heading."""
ALIGNED = 0.1
"""Angle in rad up to which a robot may turn on the spot with an object in front."""
_NEAR_PULL = 20.0
"""Weight of the goal's heading in the bearing of a goal within `NEAR`, whose own bearing is noise."""
Derived = TypeVar("Derived")


class Geometry:
    """The derived quantities of n situations, each computed once, when first asked for.

    Parameters
    ----------
    direct : mapping
        Direct variables, see `direct_table`.
    robot : Robot
        Limits, and where it holds an object.
    driving : DrivingStyle, optional
        How the action was observed to drive; by default at all limits of the base.
    further : iterable of str
        Names of direct variables that stand for goal variables which the action declares.
    room : int
        Number of rows that the table of quantities has room for besides, see `rows`.
    """

    def __init__(
        self,
        direct: Direct,
        robot: Robot,
        driving: DrivingStyle | None = None,
        *,
        further: Iterable[str] = (),
        room: int = 0,
    ) -> None:
        self.direct = direct_table(direct, further)
        self._table = self.direct.table
        self.robot = robot
        self._driving, self._room = driving, room
        self._kept: dict[Callable[[Geometry], Any], Any] = {}

    def once(self, compute: Callable[[Geometry], Derived]) -> Derived:
        """Return what `compute` returns for this geometry; only the first request calls it."""
        if compute not in self._kept:
            self._kept[compute] = compute(self)
        kept: Derived = self._kept[compute]
        return kept

    @property
    def driving(self) -> DrivingStyle:
        """How the action was observed to drive."""
        return self._driving if self._driving is not None else plain_driving(self.robot)

    @cached_property
    def rows(self) -> FloatArray:
        """Quantities that all share, shape (ROWS + room, n), see `ator_ros.performance.compiled_geometry`.

        The last rows, as many as there is `room` for, are not written.
        """
        rows = np.empty((ROWS + self._room, self._table.shape[1]))
        derive_ways(self._table, self.robot.hold, self.robot.limits.aw, rows)
        heading, dist = self.direct["yawg"], rows[DIST]
        pull = _NEAR_PULL * np.maximum(NEAR - dist, 0.0)
        bearing = np.arctan2(rows[DY] + pull * np.sin(heading), rows[DX] + pull * np.cos(heading))
        derive_angles(self._table, bearing, rows)
        return rows

    @cached_property
    def at_rest(self) -> BoolArray:
        """Whether the robot stands at the start and shall stand at the goal."""
        d = self.direct
        return np.asarray(AT_REST.holds(d["v"], d["w"]) & (d["speedg"] <= AT_REST.v))

    def with_turns(self, motions: Motions, limits: Limits) -> Motions:
        """Return the motions, with turns on the spot where a robot at rest is within `NEAR` of its goal.

        With an object in front only slight turns are possible, up to `ALIGNED`.
        """
        angle = self.rows[ANGLE_BETWEEN]
        near = self.at_rest & (self.dist < NEAR) & ((self.direct["hold"] < 0.5) | (angle <= ALIGNED))
        if not near.any():
            return motions
        turning = turn_time(angle, limits.w, limits.aw)
        return Motions(np.where(near, turning, motions.time), np.where(near, angle, motions.turn))

    @property
    def destination(self) -> tuple[FloatArray, FloatArray]:
        """Where the axle shall come, in m: behind the goal's position if a held object shall come there."""
        return self.rows[TO_X], self.rows[TO_Y]

    @property
    def dist(self) -> FloatArray:
        """Distance from start to destination in m."""
        dist: FloatArray = self.rows[DIST]
        return dist

    @property
    def to_dest(self) -> FloatArray:
        """Signed angle in rad from the heading to the destination's bearing."""
        angle: FloatArray = self.rows[TO_DEST]
        return angle

    @property
    def at_dest(self) -> FloatArray:
        """Signed angle in rad from the destination's bearing to the heading there."""
        angle: FloatArray = self.rows[AT_DEST]
        return angle

    @property
    def openings(self) -> FloatArray:
        """States in which the initial rotation has stopped: x, y (m), heading (rad), the time (s); (4, n).

        The speed stays what it is until then.
        """
        return self.rows[OPENING : OPENING + 4]

    def fastest_to(
        self, family: Family, x: FloatArray, y: FloatArray, heading: FloatArray, speed: FloatArray
    ) -> Motions:
        """Return the fastest motions of a family to one of m destinations, whichever is reached first.

        Parameters
        ----------
        family : Family
            The motions to choose from; before them the rotation of the start is lost.
        x, y, heading, speed : ndarray, shape (n,) or (m, n)
            Where the axle shall come (m), and heading (rad) and speed (m/s) there.
        """
        to_x, to_y, headings, arrivals = (
            column if column.ndim == 2 else column[None, :] for column in (x, y, heading, speed)
        )
        ends = np.empty((5, *to_x.shape))
        see_ends(self.openings, self._table[V], to_x, to_y, headings, arrivals, ends)
        return fastest_motions(ends, family, hold=self.robot.hold).after(self.openings[3])

    @cached_property
    def path(self) -> Motions:
        """The fastest turn-straight-turn path at the limits that were observed.

        Where none leads there it is turning on the spot, driving and turning, at the robot's limits.
        """
        d, (from_x, from_y, yaw, opening) = self.direct, self.openings
        x, y = self.destination
        dx, dy, cos, sin = x - from_x, y - from_y, np.cos(yaw), np.sin(yaw)
        turn = wrap_angles(d["yawg"] - yaw)
        ends = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, turn, d["v"], d["speedg"]])
        time, turned = np.empty(len(ends)), np.empty(len(ends))
        for holding in (False, True):
            rows = (d["hold"] > 0.5) == holding
            if rows.any():
                found = path_times(ends[rows], self.driving, hold=self.robot.hold, holding=holding)
                time[rows], turned[rows] = found.time, found.turn
        # Where no path leads there the robot must turn on the spot, drive, and turn again.
        missing = ~np.isfinite(time)
        time[missing] = self.turn_drive_turn()[missing]
        turned[missing] = (np.abs(self.to_dest) + np.abs(self.at_dest))[missing]
        return self.with_turns(Motions(time, turned).after(opening), self.driving.limits)

    def turn_drive_turn(self, *, reverse: bool = False) -> FloatArray:
        """Return the time in s of turning on the spot, driving, and turning again."""
        first, last = np.abs(self.to_dest), np.abs(self.at_dest)
        if reverse:
            first, last = np.pi - first, np.pi - last
        rates = rates_of(self.robot.limits)
        rest = np.zeros_like(self.dist)
        driving = drive_time(self.dist, rest, self.direct["speedg"], rates)
        turning = turn_time(first, rates.w, rates.aw)
        result: FloatArray = turning + driving + turn_time(last, rates.w, rates.aw)
        return result
