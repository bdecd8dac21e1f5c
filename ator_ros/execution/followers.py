"""How bases follow commands: the range of their speeds, and those of delayed ones. Without ROS."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from ator_ros.bases.interface import Axis
from ator_ros.geometry import FloatArray, clip

LATE = 0.1
"""Time in s by which a base may be later than `latency`: two messages at 20 Hz."""
_WEAK = 0.5  # share of the described change of speed that it reaches: with a load
_STRONG = 2.0  # the same of a light base; multiple of the described lag of a sluggish one
STEP = 0.025
"""Step in s of the prediction, half a tick."""
ROUNDING = 1e-6


class Commands:
    """The commands of one axis with the times in s from which they act."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._times: list[float] = []
        self._sent: list[float] = []

    def add(self, acts: float, command: float) -> None:
        """Add a command that acts from `acts` (s) on and replaces later ones."""
        earlier = bisect.bisect_left(self._times, acts)
        self._times[earlier:] = [acts]
        self._sent[earlier:] = [clip(command, self._limit)]

    def delay_last(self, seconds: float) -> None:
        """Let the last command act later."""
        if self._times:
            self._times[-1] += seconds

    def forget(self, time: float) -> None:
        """Forget the commands that no longer act at `time` (s)."""
        over = max(0, bisect.bisect_right(self._times, time) - 1)
        del self._times[:over], self._sent[:over]

    def at(self, time: float) -> float:
        """Return the command that acts at a time in s; 0 before the first one."""
        index = bisect.bisect_right(self._times, time + ROUNDING)
        return self._sent[index - 1] if index else 0.0

    def between(self, since: float, until: float) -> list[float]:
        """Return the commands that acted between two times in s; 0 before the first one."""
        begin = bisect.bisect_right(self._times, since + ROUNDING)
        end = bisect.bisect_right(self._times, until + ROUNDING)
        return [self.at(since), *self._sent[begin:end]]


class Followers:
    """The speeds of several bases that follow the commands of one axis, in arrays of shape (n,).

    `delays` (s) are negative for bases that are early; `rates` and `stops` are their changes of
    speed per s, `lags` (s) their time constants.
    """

    def __init__(
        self,
        delays: Sequence[float],
        rates: Sequence[float],
        stops: Sequence[float],
        lags: Sequence[float],
    ) -> None:
        self._delays = delays
        self._rates = np.array(rates)
        self._stops = np.array(stops)
        self._lags = np.array(lags)
        self.start(0.0)

    def start(self, speed: float) -> None:
        """Start all at a speed in m/s or rad/s."""
        self._setpoints = self.speeds = np.full(len(self._delays), speed)

    def advance(self, time: float, dt: float, commands: Commands) -> None:
        """Follow the commands of `time` (s) for `dt` s."""
        sent = np.array([commands.at(time - delay) for delay in self._delays])
        most = np.where(sent == 0.0, self._stops, self._rates) * dt
        self._setpoints = self._setpoints + np.clip(sent - self._setpoints, -most, most)
        share = np.minimum(1.0, dt / np.maximum(self._lags, dt))
        self.speeds = self.speeds + (self._setpoints - self.speeds) * share


class Response:
    """The range of speeds of bases that follow the commands of one axis.

    The most prompt base is early, without lag, and twice as strong as described; its speeds count
    as long as a late one may be behind. A sluggish one is late and has twice the lag. A loaded one
    is also half as strong, and does not stop faster than it brakes. `delayed` are the speeds of
    bases that are later than `latency` by `delays` (s) and reach `strengths`, shares of the
    described change of speed, all of shape (n,).
    """

    def __init__(
        self,
        axis: Axis,
        lag: float,
        early: float,
        delays: Sequence[float],
        strengths: Sequence[float],
    ) -> None:
        rates = [share * axis.rate for share in strengths]
        stops = [share * axis.stop for share in strengths]
        strong, weak = _STRONG * axis.rate, _WEAK * axis.rate
        self._followers = Followers(
            [-early - STEP, LATE, LATE, *delays],
            [strong, axis.rate, weak, *rates],
            [_STRONG * axis.stop, axis.stop, weak, *stops],
            [0.0, _STRONG * lag, _STRONG * lag, *[lag] * len(delays)],
        )
        self._spread = early + LATE
        self._recent: deque[tuple[float, float]] = deque()  # times in s and the most prompt speeds
        self.low = self.high = 0.0
        self.least = 0.0
        """The slowest of the speeds that are expected; 0 if a base that follows may stand."""

    @property
    def delayed(self) -> FloatArray:
        """The speeds of delayed bases, shape (n,)."""
        return self._followers.speeds[3:]

    def start(self, time: float, speed: float) -> None:
        """Start at a speed in m/s or rad/s at `time` (s)."""
        self._followers.start(speed)
        self._recent.append((time, speed))

    def advance(self, since: float, until: float, commands: Commands) -> None:
        """Follow the commands between two times in s."""
        steps = math.ceil((until - since) / STEP - ROUNDING)
        for step in range(steps):
            dt = (until - since) / steps
            time = since + step * dt
            self._followers.advance(time, dt, commands)
            self._recent.append((time + dt, float(self._followers.speeds[0])))
        while len(self._recent) > 1 and self._recent[0][0] < until - self._spread - ROUNDING:
            self._recent.popleft()
        _, sluggish, loaded = self._followers.speeds[:3].tolist()
        speeds = [sluggish, *(speed for _, speed in self._recent)]
        self.low = min(loaded, *speeds)
        self.high = max(loaded, *speeds)
        self.least = min(speeds, key=abs) if self.low * self.high > 0.0 else 0.0
