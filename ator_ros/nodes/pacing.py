"""Limits of how often something happens (without ROS; the clock is passed in)."""

from __future__ import annotations

from collections.abc import Callable


class Pace:
    """Allows things at a steady rate, and some at once after a pause.

    Parameters
    ----------
    clock : callable
        Returns the time in s.
    rate : float
        How many are allowed in a second.
    at_once : int
        How many are allowed together after a pause.
    """

    def __init__(self, clock: Callable[[], float], *, rate: float, at_once: int) -> None:
        self._clock, self._rate, self._at_once = clock, rate, float(at_once)
        self._left, self._last = self._at_once, clock()

    def allows(self) -> bool:
        """Return whether one more is allowed now, which then counts."""
        now = self._clock()
        self._left = min(self._at_once, self._left + self._rate * (now - self._last))
        self._last = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
