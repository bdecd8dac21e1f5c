"""Velocities of objects and robots that report only positions or poses."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ator_ros.geometry import Pose
from ator_ros.world.state import ObjectState, RobotState

_SPAN = 0.3
"""Time in s over which positions tell the velocity."""
_LEAST = 0.05
"""Time in s that positions must span; until then the object counts as at rest."""
_FASTEST = 20.0
"""Speed in m/s above which an object was found elsewhere instead of moving: other robots reach 15 m/s."""
_KEPT = 64
_ROBOT_SPAN = 0.04
"""Least time in s over which two poses of the robot tell its velocity: one tick at 20 Hz, four at 100 Hz."""
_ROUNDING = 1e-6
_JUMP = 1.5
"""A robot that seems to move so many times as fast as its limits was found elsewhere, or is turned about."""


class VelocityEstimate:
    """Fits a straight line to the recent positions of one object."""

    def __init__(self) -> None:
        self._sights: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)

    def state(self, time: float, x: float, y: float) -> ObjectState:
        """Process a position (m) at `time` (s); return it with its velocity.

        Positions older than a jump, or after the present one, as after a reset of time, are forgotten. The
        velocity is that of the middle of the span: of an object that accelerates it is late by 0.15 s.
        """
        if self._sights and not self._continues(time, x, y):
            self._sights.clear()
        if not self._sights or time > self._sights[-1][0]:
            self._sights.append((time, x, y))
        while self._sights[0][0] < time - _SPAN:
            self._sights.popleft()
        return ObjectState(x, y, *self._velocity())

    def _continues(self, time: float, x: float, y: float) -> bool:
        before, old_x, old_y = self._sights[-1]
        elapsed = time - before
        if not 0.0 <= elapsed <= _SPAN:
            return False
        return bool(np.hypot(x - old_x, y - old_y) <= _FASTEST * max(elapsed, _LEAST))

    def _velocity(self) -> tuple[float, float]:
        """Return the slope of the line of least squares through the positions, in m/s."""
        times, xs, ys = np.array(self._sights).T
        if times[-1] - times[0] < _LEAST:
            return 0.0, 0.0
        past = times - times.mean()
        slope = past / (past @ past)
        return float(slope @ xs), float(slope @ ys)


class RobotVelocity:
    """The velocity of a robot by differences of its poses, as along an arc between two of them.

    Parameters
    ----------
    most_v, most_w : float
        The robot's limits in m/s and rad/s. Where one pose is out of the reach of that before, as where a map
        corrects it, the velocity stays as it was.
    """

    def __init__(self, most_v: float, most_w: float) -> None:
        self._most_v, self._most_w = _JUMP * most_v, _JUMP * most_w
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=_KEPT)
        self._velocity, self._jumped = (0.0, 0.0), False

    def state(self, time: float, pose: Pose) -> RobotState:
        """Process a pose at `time` (s); return it with its velocity.

        That is late by half of the time that it was taken over, 0.04 s or what lies between two poses. After
        a gap of more than 0.3 s, or where time goes back, the robot counts as at rest.
        """
        if self._poses and not 0.0 <= time - self._poses[-1][0] <= _SPAN:
            self._poses.clear()
            self._velocity, self._jumped = (0.0, 0.0), False
        if not self._poses or time > self._poses[-1][0]:
            self._poses.append((time, pose))
        while len(self._poses) > 1 and time - self._poses[1][0] > _ROBOT_SPAN - _ROUNDING:
            self._poses.popleft()
        first, before = self._poses[0]
        if time - first > _ROBOT_SPAN - _ROUNDING:
            self._take(before.relative(pose), time - first, (time, pose))
        return RobotState(pose, *self._velocity)

    def _take(self, moved: Pose, elapsed: float, newest: tuple[float, Pose]) -> None:
        """Take the velocity of a motion, unless it is a jump; two jumps in a row are believed."""
        half = moved.yaw / 2.0
        along = moved.x * math.cos(half) + moved.y * math.sin(half)
        chord = math.sin(half) / half if half else 1.0
        v, w = along / chord / elapsed, moved.yaw / elapsed
        sideways = abs(moved.y * math.cos(half) - moved.x * math.sin(half)) / elapsed
        jumps = max(abs(v), sideways) > self._most_v or abs(w) > self._most_w
        if jumps and not self._jumped:
            self._poses.clear()
            self._poses.append(newest)
        else:
            self._velocity = v, w
        self._jumped = jumps
