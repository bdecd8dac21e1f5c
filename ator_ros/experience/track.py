"""The states in a part of a recording: odometry, commands and objects, interpolated.

Where pose and twist contradict each other, the poses decide.
"""

from __future__ import annotations

import copy
import math
from array import array
from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.experience.records import FASTEST
from ator_ros.geometry import FloatArray, IntArray, Pose, wrap_angles
from ator_ros.world.robot_velocity import TWIST_TOLERANCE
from ator_ros.world.state import ObjectState, RobotState, Standstill, World

PERIOD = 0.1  # s between examples, the paper's 10 Hz
NOT_DRIVEN = Standstill(0.01, 0.02)
"""Greatest speeds of a command to stop, and greatest measured speeds of a robot at rest."""
# m or rad between two messages, beyond `FASTEST`, above which the pose has jumped
_JUMP_SLACK = 0.1
# m/s or rad/s above which pose and twist are compared: 1 cm of noise in twice `_BESIDE`
_MOVING = 0.05
_BESIDE = 0.1  # s before and after a state between which its velocity is derived from the poses
# s for which pose and twist have to contradict each other; a jump of the pose takes twice `_BESIDE`
_LEAST_TIME = 1.0
_JUMPS = "the pose jumps during the drive"
_CONTRADICTS = "poses and velocities contradict each other: the pose was reset, or the robot moved"
# m and rad by which a drive may end elsewhere than its velocities lead, besides `TWIST_TOLERANCE`
_ELSEWHERE = (0.2, 0.4)
WIDTH = 7  # columns of odometry
ROUNDING = 1e-6  # s; stamps since 1970 are rounded to 0.24 us
DIGITS = 6  # of times in s, likewise


class Rows:
    """Rows of `width` numbers, the time in s first; they need no more memory than the numbers."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._numbers = array("d")

    def __len__(self) -> int:
        return len(self._numbers) // self._width

    def append(self, *row: float) -> None:
        """Append a row."""
        self._numbers.extend(row)

    @property
    def first(self) -> tuple[float, ...]:
        """The first row."""
        return tuple(self._numbers[: self._width])

    @property
    def last(self) -> tuple[float, ...]:
        """The last row."""
        return tuple(self._numbers[-self._width :])

    def in_order(self) -> FloatArray:
        """Return the rows as a table (n, width) in the order of their times."""
        table: FloatArray = np.array(self._numbers, dtype=float).reshape(-1, self._width)
        times = table[:, 0]
        if (times[1:] >= times[:-1]).all():
            return table
        return table[np.argsort(times, kind="stable")]


@dataclass
class Segment:
    """Recorded without a gap: rows of odometry, commands and objects.

    odom: t, x, y, yaw, v, w, vy; cmd_vel: t, speed, w; objects: t, x, y of each.
    """

    odom: Rows = field(default_factory=lambda: Rows(WIDTH))
    cmd_vel: Rows = field(default_factory=lambda: Rows(3))
    objects: dict[str, Rows] = field(default_factory=lambda: defaultdict(lambda: Rows(3)))

    @cached_property
    def track(self) -> Track:
        """The states in it, once all messages are there."""
        return Track(self)


class Track:
    """The states in a segment with odometry, interpolated between the messages.

    Attributes
    ----------
    odom : ndarray, shape (n, 7)
        t, x, y, yaw, v, w, vy in the order of time, with unwrapped yaw.
    begin, end : float
        Times in s of the first and the last odometry.
    objects : mapping of str to ndarray, shape (n, 3)
        t, x, y of each object with messages.
    corrected : set of str
        The parts of the twist that contradict the poses and are derived from them.
    """

    def __init__(self, segment: Segment) -> None:
        self.odom = segment.odom.in_order()
        self.odom[:, 3] = np.unwrap(self.odom[:, 3])
        self.corrected = _correct_twists(self.odom)
        self._times = np.ascontiguousarray(self.odom[:, 0])  # searching a column would copy it
        self.objects = {name: rows.in_order() for name, rows in segment.objects.items() if rows}
        self._odom_pose = Pose(0.0, 0.0, 0.0)
        self.begin = float(self.odom[0, 0])
        self.end = float(self.odom[-1, 0])
        self._rows = [
            np.vstack([np.round(table[:, 0] - self.begin, DIGITS), table.T[1:]])
            for table in (self.odom, *self.objects.values())
        ]

    def seen_from(self, odom_pose: Pose) -> Track:
        """Return it in the frame in which odometry's frame is at `odom_pose`.

        The tables stay as they are.
        """
        other = copy.copy(self)
        other._odom_pose = odom_pose
        return other

    def states(self, times: FloatArray) -> FloatArray:
        """Return the states at times (n,) in s, which increase.

        A row has t, x, y, yaw, v, w, vy, then x and y of each object, NaN before its first message.
        """
        since = np.round(times - self.begin, DIGITS)
        columns = [
            np.interp(since, stamps, row, left=np.nan)
            for stamps, *rows in self._rows
            for row in rows
        ]
        states = np.column_stack([times, *columns])
        x, y, yaw = self._odom_pose
        turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        for first in (1, *range(WIDTH, states.shape[1], 2)):
            states[:, first : first + 2] = states[:, first : first + 2] @ turn + (x, y)
        states[:, 3] = wrap_angles(states[:, 3] + yaw)
        return states

    def world(self, time: float) -> World:
        """Return the state at `time` (s), with the objects that had a message by then."""
        _, x, y, yaw, vx, w, vy, *places = self.states(np.array([time]))[0].tolist()
        found = zip(self.objects, places[::2], places[1::2], strict=True)
        objects = {name: ObjectState(*place) for name, *place in found if not math.isnan(place[0])}
        return World(time, RobotState(Pose(x, y, yaw), vx, w, vy=vy), objects)

    def samples(self, begin: float, end: float, objects: Collection[str]) -> FloatArray:
        """Return the samples of an episode from `begin` to `end` (s); see `Episode`."""
        count = int((end - begin - ROUNDING) / PERIOD) + 1
        times: FloatArray = PERIOD * np.arange(count, dtype=float)
        states = self.states(begin + times)
        of_robot = np.full(WIDTH, True)
        of_objects = np.repeat([name in objects for name in self.objects], 2)
        states[:, 0] = times
        return states[:, np.append(of_robot, of_objects).astype(bool)]

    def jump(self, robot: Robot, since: float, until: float) -> str:
        """Return that the pose jumps between two times (s), or contradicts the twist.

        It is empty if neither holds. The robot may drive faster than described: see `FASTEST`.
        """
        times = self._times
        first = max(0, int(np.searchsorted(times, since, "right")) - 1)
        during = self.odom[first : np.searchsorted(times, until, "right")]
        elapsed = np.diff(during[:, 0])
        lengths = np.hypot(np.diff(during[:, 1]), np.diff(during[:, 2]))
        turns = np.abs(wrap_angles(np.diff(during[:, 3])))
        beyond = np.maximum(
            lengths - FASTEST * robot.greatest_speed() * elapsed,
            turns - FASTEST * robot.greatest_turn_rate * elapsed,
        )
        if (beyond > _JUMP_SLACK).any():
            return _JUMPS
        return _CONTRADICTS if _is_elsewhere(during) else ""

    def between(self, since: float, until: float) -> FloatArray:
        """Return the rows of odometry from one time (s) to another, both included."""
        begin = np.searchsorted(self._times, since)
        return self.odom[begin : np.searchsorted(self._times, until, "right")]

    def stood(self, since: float, until: float) -> bool:
        """Return whether the robot stood at any time between two (s)."""
        times = self._times
        during = self.odom[np.searchsorted(times, since, "right") : np.searchsorted(times, until)]
        return bool(NOT_DRIVEN.holds(np.hypot(during[:, 4], during[:, 6]), during[:, 5]).any())


def _is_elsewhere(odom: FloatArray) -> bool:
    """Return whether poses of a drive end elsewhere than its velocities lead."""
    if len(odom) < 2:
        return False
    elapsed = np.diff(odom[:, 0])
    speeds = (odom[1:, 4:] + odom[:-1, 4:]) / 2.0
    along, turned, aside = (speeds * elapsed[:, None]).T
    heading = (odom[1:, 3] + odom[:-1, 3]) / 2.0
    x = along * np.cos(heading) - aside * np.sin(heading)
    y = along * np.sin(heading) + aside * np.cos(heading)
    moved = odom[-1, 1:4] - odom[0, 1:4]
    off = math.hypot(moved[0] - x.sum(), moved[1] - y.sum())
    off_turned = abs(moved[2] - turned.sum())
    farthest = max(np.hypot(along, aside).sum(), math.hypot(moved[0], moved[1]))
    most_turned = max(np.abs(turned).sum(), abs(moved[2]))
    return bool(
        off > _ELSEWHERE[0] + TWIST_TOLERANCE * farthest
        or off_turned > _ELSEWHERE[1] + TWIST_TOLERANCE * most_turned
    )


def _correct_twists(odom: FloatArray) -> set[str]:
    """Derive velocities that contradict the poses from them, in place; return which these are.

    Columns are t, x, y, yaw, v, w. A driver without signs reports how fast the robot drives
    backward as if it drove forward: then the sign alone is corrected.
    """
    times = odom[:, 0]
    corrected = set[str]()
    by_poses = _velocities_by_pose(odom)
    for column, name, by_pose in zip((4, 5), ("linear", "angular"), by_poses, strict=True):
        if _contradicts(times, odom[:, column], by_pose):
            signed = np.copysign(odom[:, column], by_pose)
            odom[:, column] = by_pose if _contradicts(times, signed, by_pose) else signed
            corrected.add(f"twist.{name}")
    return corrected


def _velocities_by_pose(odom: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return v (n,) in m/s and w (n,) in rad/s by the poses `_BESIDE` each state.

    Just before and after a rest only the side of the rest counts: else the robot would seem to
    stop later than it does.
    """
    times = odom[:, 0]
    here = np.arange(len(odom))
    before = np.searchsorted(times, times - _BESIDE)
    after = np.minimum(np.searchsorted(times, times + _BESIDE, "right"), len(odom)) - 1
    v, w = _mean_velocities(odom, before, after)
    for first, last in ((before, here), (here, after)):
        mean_v, mean_w = _mean_velocities(odom, first, last)
        at_rest = (times[first] < times[last]) & NOT_DRIVEN.holds(mean_v, mean_w)
        v[at_rest] = mean_v[at_rest]
        w[at_rest] = mean_w[at_rest]
    return v, w


def _mean_velocities(
    odom: FloatArray, first: IntArray, last: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return v and w between rows of odometry by their poses; by their twist if no time passes."""
    elapsed = odom[last, 0] - odom[first, 0]
    moved = odom[last, 1:4] - odom[first, 1:4]
    heading = odom[first, 3] + moved[:, 2] / 2.0
    along = moved[:, 0] * np.cos(heading) + moved[:, 1] * np.sin(heading)
    known = elapsed > 0.0
    v = np.divide(along, elapsed, out=odom[first, 4], where=known)
    w = np.divide(moved[:, 2], elapsed, out=odom[first, 5], where=known)
    return v, w


def _contradicts(times: FloatArray, by_twist: FloatArray, by_pose: FloatArray) -> bool:
    """Return whether velocities by twist contradict those by poses in most of either direction.

    More than twice the usual velocity is a jump of the pose and does not count. Contradictions of
    less than `_LEAST_TIME` in all do not count either.
    """
    usual = np.abs(by_pose) > _MOVING
    if not usual.any() or len(times) < 2:
        return False
    usual &= np.abs(by_pose) <= 2.0 * np.percentile(np.abs(by_pose[usual]), 95.0)
    spans = np.gradient(times)
    off = np.abs(by_twist - by_pose)
    faster = np.maximum(np.abs(by_twist), np.abs(by_pose))
    contradicting = off > TWIST_TOLERANCE * faster + _MOVING
    for direction in (by_pose > 0.0, by_pose < 0.0):
        moving = usual & direction
        time = spans[moving & contradicting].sum()
        if time > max(_LEAST_TIME, 0.5 * spans[moving].sum()):
            return True
    return False
