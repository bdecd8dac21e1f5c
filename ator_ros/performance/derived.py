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
from ator_ros.performance.direct import Direct, direct_arrays
from ator_ros.performance.driving import DrivingStyle, plain_driving
from ator_ros.performance.paths import path_times
from ator_ros.robot.description import Robot

Derived = TypeVar("Derived")


class Geometry:
    """The derived quantities of n situations, each computed once, when first asked for.

    Parameters
    ----------
    direct : mapping
        Direct variables, see `direct_arrays`.
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
        self.direct = direct_arrays(direct, further)
        self.robot = robot
        self.driving = driving if driving is not None else plain_driving(robot)
        self._kept: dict[Callable[[Geometry], Any], Any] = {}

    def once(self, compute: Callable[[Geometry], Derived]) -> Derived:
        """Return what `compute` returns for this geometry; only the first request calls it."""
        if compute not in self._kept:
            self._kept[compute] = compute(self)
        kept: Derived = self._kept[compute]
        return kept

    @cached_property
    def destination(self) -> tuple[FloatArray, FloatArray]:
        """Where the axle shall come, in m: behind the goal's position if a held object shall come there."""
        d = self.direct
        back = self.robot.hold * d["hold"]
        return d["xg"] - back * np.cos(d["yawg"]), d["yg"] - back * np.sin(d["yawg"])

    @cached_property
    def dx(self) -> FloatArray:
        """From start to destination along x in m."""
        return self.destination[0] - self.direct["x"]

    @cached_property
    def dy(self) -> FloatArray:
        """From start to destination along y in m."""
        return self.destination[1] - self.direct["y"]

    @cached_property
    def dist(self) -> FloatArray:
        """Distance from start to destination in m."""
        return np.asarray(np.sqrt(self.dx * self.dx + self.dy * self.dy))

    @cached_property
    def _bearing(self) -> FloatArray:
        return np.arctan2(self.dy, self.dx)

    @cached_property
    def to_dest(self) -> FloatArray:
        """Signed angle in rad from the heading to the destination's bearing."""
        return wrap_angles(self._bearing - self.direct["yaw"])

    @cached_property
    def at_dest(self) -> FloatArray:
        """Signed angle in rad from the destination's bearing to the heading there."""
        return wrap_angles(self.direct["yawg"] - self._bearing)

    @cached_property
    def turn(self) -> FloatArray:
        """Signed angle in rad from the heading at the start to that at the destination."""
        return wrap_angles(self.direct["yawg"] - self.direct["yaw"])

    @cached_property
    def side(self) -> FloatArray:
        """1 where the destination lies to the left, else -1."""
        return np.where(self.to_dest >= 0.0, 1.0, -1.0)

    @cached_property
    def _opening(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Pose (m, m, rad) and time (s) at which the rotation of the start is lost, at constant speed."""
        d, aw = self.direct, self.robot.limits.aw
        time = np.abs(d["w"]) * (1.0 / aw)
        half = 0.5 * d["w"] * time
        heading = d["yaw"] + (2.0 / 3.0) * half  # in the mean
        way = d["v"] * time
        return d["x"] + way * np.cos(heading), d["y"] + way * np.sin(heading), d["yaw"] + half, time

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
        from_x, from_y, yaw, opening = self._opening
        dx, dy = x - from_x, y - from_y
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = wrap_angles(heading - yaw)
        columns = (cos * dx + sin * dy, cos * dy - sin * dx, turn, self.direct["v"], speed)
        ends = np.empty((len(columns), *turn.shape))
        for row, column in zip(ends, columns, strict=True):
            row[...] = column
        shaped = ends.reshape(len(columns), -1, len(opening))
        return fastest_motions(shaped, family, hold=self.robot.hold).after(opening)

    @cached_property
    def path(self) -> Motions:
        """The fastest turn-straight-turn path at the limits that were observed."""
        d, (from_x, from_y, yaw, opening) = self.direct, self._opening
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
        return turn_time(first, rates.w, rates.aw) + driving + turn_time(last, rates.w, rates.aw)
