"""What a robot recorded of odometry, commands and objects, and the states between."""

from __future__ import annotations

import bisect
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ator_ros.experience.episode import sample_of
from ator_ros.experience.records import finite, pose_of
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.world.state import ObjectState, RobotState, World

SILENCE = 1.0  # s without odometry after which another stretch of time begins
PERIOD = 0.1  # s between examples, the paper's 10 Hz


@dataclass
class Streams:
    """A stretch of a robot's time: odom (t, x, y, yaw, v, w), commands (t, v, w), objects (t, x, y)."""

    odom: list[tuple[float, ...]] = field(default_factory=list)
    cmd_vel: list[tuple[float, ...]] = field(default_factory=list)
    objects: dict[str, list[tuple[float, ...]]] = field(default_factory=lambda: defaultdict(list))

    def goes_on_at(self, time: float) -> bool:
        """Return whether odometry of `time` (s) follows: not after a reset, nor after a long silence."""
        return not self.odom or 0.0 <= time - self.odom[-1][0] <= SILENCE


class Stretches:
    """What one robot recorded; the next stretch of its time begins after a reset or a long silence.

    Attributes
    ----------
    all : list of Streams
        In order; the last one grows.
    frame : str
        The frame of the newest odometry.
    """

    def __init__(self) -> None:
        self.all = [Streams()]
        self.frame = ""

    @property
    def newest(self) -> Streams:
        """The stretch that grows."""
        return self.all[-1]

    def take(self, topic: str, message: Any) -> None:
        """Take a message of `odom`, `cmd_vel`, or an object; one with numbers that are none is left out."""
        if topic == "cmd_vel":
            # A Twist has no stamp: it counts from the last odometry on, which is in the robot's own time.
            twist, odom = getattr(message, "twist", message), self.newest.odom
            command = (odom[-1][0] if odom else math.nan, twist.linear.x, twist.angular.z)
            if finite(command):
                self.newest.cmd_vel.append(command)
            return
        time, pose, twist = time_of(message), pose_of(message.pose.pose), message.twist.twist
        if topic != "odom":
            if finite(pose):
                self.newest.objects[topic].append((time, pose.x, pose.y))
        elif finite(row := (time, *pose, twist.linear.x, twist.angular.z)):
            if not self.newest.goes_on_at(time):
                self.all.append(Streams())
            self.frame = message.header.frame_id
            self.newest.odom.append(row)


def time_of(message: Any) -> float:
    """Return the stamp of a message in s."""
    stamp = message.header.stamp
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def kind_of(topic: str, topics: Sequence[str]) -> str:
    """Return which of `topics` a topic is, in whatever namespace; empty for none."""
    return next((name for name in topics if f"/{topic}".endswith(f"/{name}")), "")


class Track:
    """The states of one stretch at any time, between those that were recorded.

    Parameters
    ----------
    streams : Streams
        With odometry.

    Attributes
    ----------
    odom : ndarray, shape (n, 6)
        In order of time, with yaw that does not jump.
    begin, end : float
        Times in s of the first and the last odometry.
    names : tuple of str
        The objects that were seen.
    """

    def __init__(self, streams: Streams) -> None:
        self.odom = in_order(streams.odom)
        self.odom[:, 3] = np.unwrap(self.odom[:, 3])
        self._objects = {name: in_order(rows) for name, rows in streams.objects.items() if rows}
        self.begin, self.end = float(self.odom[0, 0]), float(self.odom[-1, 0])
        self.names = tuple(self._objects)

    def pose(self, time: float) -> Pose:
        """Return the robot's pose at `time` (s)."""
        return _pose(_at(self.odom, time))

    def world(self, time: float) -> World:
        """Return the state at `time` (s)."""
        row = _at(self.odom, time)
        return World(time, RobotState(_pose(row), float(row[4]), float(row[5])), self.objects(time))

    def objects(self, time: float) -> dict[str, ObjectState]:
        """Return the objects that had been seen by `time` (s)."""
        seen = {name: _at(table, time) for name, table in self._objects.items() if time >= table[0, 0]}
        return {name: ObjectState(float(row[1]), float(row[2])) for name, row in seen.items()}

    def samples(self, begin: float, end: float) -> FloatArray:
        """Return the samples of an episode from `begin` to `end` (s); see `Episode`."""
        times = [begin + number * PERIOD for number in range(int((end - begin) / PERIOD - 1e-9) + 1)]
        rows = [
            (number * PERIOD, *sample_of(self.world(time), begin, self.names)[1:])
            for number, time in enumerate(times)
        ]
        return np.array(rows, dtype=float)


def in_order(rows: list[tuple[float, ...]]) -> FloatArray:
    """Return rows as a table in the order of their times, which come first."""
    table = np.array(rows, dtype=float)
    return table[np.argsort(table[:, 0], kind="stable")]


def _at(table: FloatArray, time: float) -> FloatArray:
    after = bisect.bisect_right(table[:, 0], time)
    rows = table[max(0, after - 1) : after + 1]  # all that matters, of a table that may be long
    return np.array([np.interp(time, rows[:, 0], column) for column in rows.T])


def _pose(row: FloatArray) -> Pose:
    return Pose(float(row[1]), float(row[2]), wrap_angle(float(row[3])))
