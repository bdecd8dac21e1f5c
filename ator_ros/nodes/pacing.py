"""Limits of how often something happens (without ROS; the clock is passed in)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

Send = Callable[[], None]
"""Sends one message."""


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


class Outbox:
    """Messages that leave at a pace; urgent ones overtake the others.

    Parameters
    ----------
    urgent, others : Pace
        How often one of each kind may leave.
    most : int
        How many may wait; beyond that they leave at once, so that memory stays bounded.
    """

    def __init__(self, urgent: Pace, others: Pace, *, most: int) -> None:
        self._paces, self._most = (urgent, others), most
        self._urgent: deque[Send] = deque()
        self._others: deque[Send] = deque()

    def __len__(self) -> int:
        """Return how many messages wait."""
        return len(self._urgent) + len(self._others)

    def add(self, send: Send, *, urgent: bool) -> None:
        """Take a message; it leaves at one of the next calls of `work`."""
        (self._urgent if urgent else self._others).append(send)

    def work(self) -> None:
        """Send as many of the messages that wait as the paces allow."""
        for queue, pace in zip((self._urgent, self._others), self._paces, strict=True):
            while queue and (len(self) > self._most or pace.allows()):
                queue.popleft()()
