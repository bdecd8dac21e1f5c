"""Rate limits (without ROS; the clock is passed in)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

Send = Callable[[], None]
"""Sends one message."""


class Pace:
    """A token bucket: allows events at a steady rate, and a few at once after a pause.

    Parameters
    ----------
    clock : callable
        Returns the time in s.
    rate : float
        Events per second.
    at_once : int
        Events that are allowed together after a pause.
    """

    def __init__(self, clock: Callable[[], float], *, rate: float, at_once: int) -> None:
        self._clock, self._rate, self._at_once = clock, rate, float(at_once)
        self._left, self._last = self._at_once, clock()

    def allows(self) -> bool:
        """Return whether an event is allowed now, and count it if so."""
        now = self._clock()
        self._left = min(self._at_once, self._left + self._rate * (now - self._last))
        self._last = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Outbox:
    """A queue of messages that are sent at limited rates; urgent ones overtake the others.

    Parameters
    ----------
    urgent, others : Pace
        Rate limits of both kinds.
    most : int
        Greatest length of the queue. Beyond it messages are sent at once, so that memory stays bounded.
    """

    def __init__(self, urgent: Pace, others: Pace, *, most: int) -> None:
        self._paces, self._most = (urgent, others), most
        self._urgent: deque[Send] = deque()
        self._others: deque[Send] = deque()

    def __len__(self) -> int:
        """Return the number of messages that wait."""
        return len(self._urgent) + len(self._others)

    def add(self, send: Send, *, urgent: bool) -> None:
        """Add a message, which one of the next calls of `work` sends."""
        (self._urgent if urgent else self._others).append(send)

    def work(self) -> None:
        """Send as many messages as the rates allow."""
        for queue, pace in zip((self._urgent, self._others), self._paces, strict=True):
            while queue and (len(self) > self._most or pace.allows()):
                queue.popleft()()
