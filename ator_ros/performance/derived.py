"""Quantities derived from the direct variables: what features are made of (paper, section 4.1)."""

from __future__ import annotations

import itertools
from functools import cached_property

import numpy as np

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.motion.durations import drive_time, rates_of, turn_time
from ator_ros.motion.families import Family, approach_family, dribble_family, drive_family, shot_family
from ator_ros.motion.ideal_times import Motions, fastest_motions
from ator_ros.performance.direct import Direct, direct_arrays
from ator_ros.robot.description import Robot

# The ideal shots, nine of them; the action itself chooses among more: m before the goal at which the ball is
# let go, and where into the goal's mouth, in shares of its width from the middle, in which direction (rad).
RELEASE = 0.33
_AIMS, _SHOTS = np.array(list(itertools.product((-0.2, 0.0, 0.2), (-0.6, 0.0, 0.6)))).T[:, :, None]


class Geometry:
    """The derived quantities of n situations, each computed once, when first asked for.

    Parameters
    ----------
    direct : mapping
        Direct variables, see `direct_arrays`.
    robot : Robot
        Limits, and where a ball is held.
    """

    def __init__(self, direct: Direct, robot: Robot) -> None:
        self.direct = direct_arrays(direct)
        self.robot = robot
        self.features: dict[str, FloatArray] = {}  # by name, each computed for the first tree that asks

    @cached_property
    def destination(self) -> tuple[FloatArray, FloatArray]:
        """Where the axle shall come, in m: behind the ball where the goal is that of a held ball."""
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

    def _motions(
        self, family: Family, x: FloatArray, y: FloatArray, heading: FloatArray, speed: FloatArray
    ) -> Motions:
        """Return the fastest motions to the fastest of m destinations, shape (m, n), and speeds, m/s."""
        from_x, from_y, yaw, opening = self._opening
        dx, dy = x - from_x, y - from_y
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = wrap_angles(heading - yaw)
        columns = (cos * dx + sin * dy, cos * dy - sin * dx, turn, self.direct["v"], speed)
        ends = np.empty((len(columns), *turn.shape))
        for row, column in zip(ends, columns, strict=True):
            row[...] = column
        motions = fastest_motions(ends.reshape(len(columns), -1), family, hold=self.robot.hold)
        return motions.best_of(len(opening)).after(opening)

    def _to_goal(self, family: Family) -> Motions:
        return self._motions(family, *self.destination, self.direct["yawg"], self.direct["speedg"])

    @cached_property
    def drive(self) -> Motions:
        """The fastest ideal motion without the ball, or up to it where the goal is to hold one."""
        holding = self.direct["hold"] > 0.5
        if holding.all():
            return self._to_goal(approach_family(self.robot))
        plain = self._to_goal(drive_family(self.robot))
        if not holding.any():
            return plain
        approach = self._to_goal(approach_family(self.robot))
        return Motions(
            np.where(holding, approach.time, plain.time), np.where(holding, approach.turn, plain.turn)
        )

    @cached_property
    def dribble(self) -> Motions:
        """The fastest ideal motion with the ball."""
        return self._to_goal(dribble_family(self.robot))

    def turn_drive_turn(self, *, reverse: bool = False) -> FloatArray:
        """Return the time in s of turning on the spot, driving, and turning again."""
        first, last = np.abs(self.to_dest), np.abs(self.at_dest)
        if reverse:
            first, last = np.pi - first, np.pi - last
        rates = rates_of(self.robot.limits)
        rest = np.zeros_like(self.dist)
        driving = drive_time(self.dist, rest, self.direct["speedg"], rates)
        return turn_time(first, rates.w, rates.aw) + driving + turn_time(last, rates.w, rates.aw)

    @cached_property
    def _from_hold(self) -> tuple[FloatArray, FloatArray]:
        d, hold = self.direct, self.robot.hold
        dx = d["xg"] - d["x"] - hold * np.cos(d["yaw"])
        dy = d["yg"] - d["y"] - hold * np.sin(d["yaw"])
        return dx, dy

    @cached_property
    def hold_dist(self) -> FloatArray:
        """Distance in m from the hold at the start to the goal's position."""
        dx, dy = self._from_hold
        return np.asarray(np.sqrt(dx * dx + dy * dy))

    @cached_property
    def hold_bearing(self) -> FloatArray:
        """Bearing in rad, in the world, of the goal's position seen from the hold at the start."""
        dx, dy = self._from_hold
        return np.arctan2(dy, dx)

    @cached_property
    def hold_angle(self) -> FloatArray:
        """Signed angle in rad from the heading to the goal's position, seen from the hold at the start."""
        return wrap_angles(self.hold_bearing - self.direct["yaw"])

    @cached_property
    def shot(self) -> Motions:
        """The fastest ideal motion with the ball to a run, at full speed, into the goal's mouth."""
        d, width = self.direct, self.robot.scene.bays[0].width
        back = RELEASE + self.robot.hold
        heading = np.where(d["xg"] > 0.0, 0.0, np.pi) + _SHOTS
        x = d["xg"] - back * np.cos(heading)
        y = d["yg"] + width * _AIMS - back * np.sin(heading)
        fastest = self.robot.holder_for("a shot").limits.v
        return self._motions(shot_family(self.robot), x, y, heading, fastest + 0.0 * x)
