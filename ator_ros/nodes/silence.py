"""Whether a chain that somebody executes is still told of."""

from __future__ import annotations

import time
from collections.abc import Callable

LONGEST = 5.0
"""Seconds without word, which comes twice a second or oftener, after which a chain counts as lost."""
LOST = "lost: the executor does not answer"


class Silence:
    """How long nothing has been told of a chain."""

    def __init__(self) -> None:
        self._news = False
        self._heard = (0.0, 0.0)

    def hear(self) -> None:
        """Note that something was told, or that nothing need be told yet."""
        self._news = True

    def too_long(self, stamp: float, there: Callable[[], bool]) -> bool:
        """Return whether nothing has been told for too long.

        Parameters
        ----------
        stamp : float
            Time in s of the robot's newest state; while it stands nobody has anything to tell.
        there : callable
            Returns whether there is an executor; without one, real time alone counts.
        """
        now = time.monotonic()
        if self._news:
            self._news, self._heard = False, (now, stamp)
        silent, missed = now - self._heard[0], stamp - self._heard[1]
        return silent > LONGEST and (missed > LONGEST or not there())
