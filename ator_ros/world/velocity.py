"""The velocity of an object of which only positions are told."""

from __future__ import annotations

from collections import deque

import numpy as np

from ator_ros.world.state import ObjectState

_SPAN = 0.3
"""Time in s over which positions tell the velocity."""
_LEAST = 0.05
"""Time in s that positions must span; until then the object counts as at rest."""
_FASTEST = 10.0
"""Speed in m/s above which the object has not moved but was found elsewhere."""
_KEPT = 64


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
