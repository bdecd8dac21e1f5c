"""Requests that are under way at once, in turns of a millisecond (without ROS; the clock is passed in).

A turn goes to the request that has had the least time, in coarse shares, so that a short one is not delayed
by long ones. Every fourth turn goes to the oldest whose time is up, so that long ones are answered however
many short ones come.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ator_ros.refinement.slices import Slices

TURN = 0.001
"""s after which a request hands over to the next, at the end of its slice."""
SHARE = 0.008
"""s that small requests may have had and still go before larger ones that have had less."""
_FOURTH = 4


@dataclass(slots=True, eq=False)
class _Job:
    """A request under way: its work, who takes its result, its size, when it came, the time it has had."""

    work: Slices[Any]
    finish: Callable[[Any], None]
    size: int
    came: float
    had: float = 0.0
    begun: bool = False

    @property
    def rank(self) -> tuple[int, int]:
        """Less is more urgent: the shares it has had, then its size."""
        return int(self.had / SHARE), self.size


class Turns:
    """Does the work of several requests in turns.

    Parameters
    ----------
    clock : callable
        Returns the time in s.
    deadline : float
        s after its coming when a request's time is up.
    most : int
        How many requests may be under way at once.
    """

    def __init__(self, clock: Callable[[], float], *, deadline: float, most: int) -> None:
        self._clock, self._deadline, self._most = clock, deadline, most
        self._jobs: list[_Job] = []  # in the order of their coming
        self._given = 0  # turns while the time of one was up

    def __len__(self) -> int:
        """Return how many requests are under way."""
        return len(self._jobs)

    def add(self, work: Slices[Any], finish: Callable[[Any], None], *, size: int) -> bool:
        """Begin a request whose result goes to `finish`; False if there are too many already.

        Among requests that have had as many shares, those of a smaller `size` come first.
        """
        if len(self._jobs) >= self._most:
            return False
        self._jobs.append(_Job(work, finish, size, self._clock()))
        return True

    def work(self) -> None:
        """Let one request have a turn; there must be one."""
        job = self._next()
        began = now = self._clock()
        while now - began < TURN:
            late = now - job.came > self._deadline
            try:
                if job.begun:
                    job.work.send(late)
                else:
                    job.begun = True
                    next(job.work)
            except StopIteration as end:
                self._jobs.remove(job)
                job.finish(end.value)
                return
            except BaseException:
                self._jobs.remove(job)  # the others must not come to it again
                raise
            now = self._clock()
        job.had += now - began

    def _next(self) -> _Job:
        first = self._jobs[0]
        late = self._clock() - first.came > self._deadline
        self._given = self._given + 1 if late else 0
        return first if self._given % _FOURTH == 1 else min(self._jobs, key=lambda job: job.rank)
