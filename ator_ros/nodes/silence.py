"""When a chain counts as lost, because nobody tells anything of it any more."""

from __future__ import annotations

import time

from ator_ros.viewing.runs import Run

_LONGEST = 5.0
"""Seconds without word after which a chain counts as lost; an executor speaks at least twice a second."""


class Silence:
    """Measures for how long nothing was heard of a chain."""

    def __init__(self) -> None:
        self._news = True
        self._alive = (0.0, 0.0)

    def broken(self) -> None:
        """Take note that something was heard; any thread may call it."""
        self._news = True

    def is_too_long(self, stamp: float, *, there: bool) -> bool:
        """Return whether the chain is lost.

        Real seconds count. Those of the stamps count as well while there is an executor: as long as time
        stands, it has nothing to tell.

        Parameters
        ----------
        stamp : float
            Time in s of the robot's newest state.
        there : bool
            Whether there is an executor.
        """
        now = time.monotonic()
        if self._news:
            self._news, self._alive = False, (now, stamp)
        silent, missed = now - self._alive[0], stamp - self._alive[1]
        return silent > _LONGEST and (missed > _LONGEST or not there)


def lose(run: Run) -> None:
    """End a run, the end of which nobody will tell any more."""
    run.status, run.ended = "lost: the executor does not answer", True
