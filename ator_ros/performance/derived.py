"""Quantities derived from the direct variables: what features are made of (paper, section 4.1)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.motion.durations import drive_time, rates_of, turn_time
from ator_ros.motion.families import Family
from ator_ros.motion.ideal_times import Motions, fastest_motions
from ator_ros.performance.compiled_geometry import (
    derive_angles,
    derive_openings,
    derive_ways,
    see_ends,
)
from ator_ros.performance.direct import Direct, V, direct_table
from ator_ros.performance.driving import DrivingStyle, plain_driving
from ator_ros.performance.paths import path_times
from ator_ros.robot.description import Robot

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
    """

    def __init__(
        self,
        direct: Direct,
        robot: Robot,
        driving: DrivingStyle | None = None,
        *,
        further: Iterable[str] = (),
    ) -> None:
        self.direct = direct_table(direct, further)
        self._table = self.direct.table
        self.robot = robot
        self._driving = driving
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
    def _ways(self) -> tuple[FloatArray, ...]:
        """What `derive_ways` writes, six arrays."""
        ways = np.empty((6, self._table.shape[1]))
        derive_ways(self._table, self.robot.hold, ways)
        return tuple(ways)

    @property
    def destination(self) -> tuple[FloatArray, FloatArray]:
        """Where the axle shall come, in m: behind the goal's position if a held object shall come there."""
        return self._ways[0], self._ways[1]

    @property
    def dx(self) -> FloatArray:
        """From start to destination along x in m."""
        return self._ways[2]

    @property
    def dy(self) -> FloatArray:
        """From start to destination along y in m."""
        return self._ways[3]

    @property
    def dist(self) -> FloatArray:
        """Distance from start to destination in m."""
        return self._ways[4]

    @property
    def turn(self) -> FloatArray:
        """Signed angle in rad from the heading at the start to that at the destination."""
        return self._ways[5]

    @cached_property
    def _angles(self) -> tuple[FloatArray, ...]:
        """What `derive_angles` writes, three arrays."""
        angles = np.empty((3, self._table.shape[1]))
        derive_angles(self._table, np.arctan2(self.dy, self.dx), angles)
        return tuple(angles)

    @property
    def to_dest(self) -> FloatArray:
        """Signed angle in rad from the heading to the destination's bearing."""
        return self._angles[0]

    @property
    def at_dest(self) -> FloatArray:
        """Signed angle in rad from the destination's bearing to the heading there."""
        return self._angles[1]

    @property
    def side(self) -> FloatArray:
        """1 where the destination lies to the left, else -1."""
        return self._angles[2]

    @cached_property
    def openings(self) -> FloatArray:
        """States in which the initial rotation has stopped: x, y (m), heading (rad), the time (s); (4, n).

        The speed stays what it is until then.
        """
        openings = np.empty((4, self._table.shape[1]))
        derive_openings(self._table, self.robot.limits.aw, openings)
        return openings

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
        goals = (column.reshape(-1, self._table.shape[1]) for column in (x, y, heading, speed))
        to_x, to_y, headings, arrivals = goals
        ends = np.empty((5, *to_x.shape))
        see_ends(self.openings, self._table[V], to_x, to_y, headings, arrivals, ends)
        return fastest_motions(ends, family, hold=self.robot.hold).after(self.openings[3])

    @cached_property
    def path(self) -> Motions:
        """The fastest turn-straight-turn path at the limits that were observed."""
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
        return Motions(time, turned).after(opening)

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
