"""A committed motion: where the robot is to be, and how fast, at each moment."""

from __future__ import annotations

import copy
import math

import numpy as np

from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.manoeuvre import Manoeuvre
from ator_ros.motion.opening import Opening
from ator_ros.motion.profiles import Piece
from ator_ros.motion.retiming import greatest_rates
from ator_ros.robot.description import Limits
from ator_ros.world.state import CONTROL_PERIOD, RobotState

DT = 0.01
"""Time in s between two samples."""


class Trajectory:
    """A manoeuvre, after its opening if there is one, sampled every 10 ms.

    Parameters
    ----------
    manoeuvre : Manoeuvre
        A closed manoeuvre; what integration still leaves at the goal is spread over the motion.
    opening : Opening, optional
        Ends where the manoeuvre starts.

    Attributes
    ----------
    duration : float
        Time from start to goal in s.
    """

    def __init__(self, manoeuvre: Manoeuvre, opening: Opening | None = None) -> None:
        speeds, turns = manoeuvre.speed_pieces(), manoeuvre.turn_pieces()
        start, goal = manoeuvre.start, manoeuvre.goal
        if opening is not None:
            before = opening.start
            speeds.insert(0, Piece(opening.duration, before.v, before.v))
            turns.insert(0, Piece(opening.duration, before.w, 0.0))
            start = before.pose
        self.duration = sum(piece.duration for piece in speeds)
        times = np.append(np.arange(0.0, self.duration, DT), self.duration)
        self._v, self._w = _sample(speeds, times), _sample(turns, times)
        steps = np.diff(times)
        yaw = start.yaw + _integral(self._w, steps)
        middle = 0.5 * (yaw[:-1] + yaw[1:])
        travelled = 0.5 * (self._v[:-1] + self._v[1:]) * steps
        x = start.x + np.concatenate(([0.0], np.cumsum(travelled * np.cos(middle))))
        y = start.y + np.concatenate(([0.0], np.cumsum(travelled * np.sin(middle))))
        share = times / max(self.duration, DT)
        self._times = times
        self._x = x + share * (goal.x - x[-1])
        self._y = y + share * (goal.y - y[-1])
        error = (goal.yaw - yaw[-1] + np.pi) % (2.0 * np.pi) - np.pi
        self._yaw = yaw + share * error

    def at(self, time: float) -> RobotState:
        """Return the planned state at `time` s after the start; it stays at the last one afterwards."""
        index = min(max(time, 0.0), self.duration) / DT
        low = min(int(index), len(self._times) - 1)
        high = min(low + 1, len(self._times) - 1)
        span = self._times[high] - self._times[low]
        share = (min(max(time, 0.0), self.duration) - self._times[low]) / span if span > 0.0 else 0.0

        def mix(values: FloatArray) -> float:
            return float(values[low] + share * (values[high] - values[low]))

        return RobotState(Pose(mix(self._x), mix(self._y), mix(self._yaw)), mix(self._v), mix(self._w))

    def rest(self, since: float, limits: Limits) -> Trajectory:
        """Return the motion from the moment `since` (s) on, slower where it asks for more than `limits`."""
        count = max(1, math.ceil((self.duration - since) / CONTROL_PERIOD))
        moments = np.linspace(since, self.duration, count + 1)
        v, w = np.interp(moments, self._times, self._v), np.interp(moments, self._times, self._w)
        steps = np.diff(moments)
        rates = greatest_rates(v, w, steps, limits)
        times = np.concatenate(([0.0], np.cumsum(2.0 * steps / (rates[:-1] + rates[1:]))))
        return self._retimed(since, times, rates)

    def _retimed(self, since: float, times: FloatArray, rates: FloatArray) -> Trajectory:
        """Return the motion from `since` on; at `times` its time passes at `rates`, linearly in between."""
        slower = copy.copy(self)
        slower.duration = float(times[-1])
        slower._times = np.append(np.arange(0.0, slower.duration, DT), slower.duration)
        rate = np.interp(slower._times, times, rates)
        moments = since + _integral(rate, np.diff(slower._times))
        slower._v = rate * np.interp(moments, self._times, self._v)
        slower._w = rate * np.interp(moments, self._times, self._w)
        slower._x = np.interp(moments, self._times, self._x)
        slower._y = np.interp(moments, self._times, self._y)
        slower._yaw = np.interp(moments, self._times, self._yaw)
        return slower

    def poses(self) -> FloatArray:
        """Return the sampled poses, shape (n, 3): x, y in m, yaw in rad."""
        return np.stack((self._x, self._y, self._yaw), axis=1)


def _integral(values: FloatArray, steps: FloatArray) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[:-1] + values[1:]) * steps)))


def _sample(pieces: list[Piece], times: FloatArray) -> FloatArray:
    ends = np.cumsum([piece.duration for piece in pieces])
    begins = ends - [piece.duration for piece in pieces]
    knots = np.stack((begins, ends), axis=1).ravel()
    values = np.array([(piece.start, piece.end) for piece in pieces]).ravel()
    return np.asarray(np.interp(times, knots, values))
