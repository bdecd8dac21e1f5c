"""Fair scheduling of concurrent requests in turns of a millisecond (without ROS; the clock is passed in).

The request that has had the least time, counted in coarse shares, is served next, so that long requests do
not delay short ones. Every fourth turn goes to the oldest request that is past its deadline, so that long
requests are answered however many short ones come.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ator_ros.refinement.slices import Slices

TURN = 0.001
"""Length of a turn in s; it ends with the slice of work in which this is exceeded."""
SHARE = 0.008
"""Resolution in s of the time that a request has had; within one share the smaller request goes first."""
_FOURTH = 4


@dataclass(slots=True, eq=False)
class _Job:
    """A request: its work, the callback for its result, its size, and its arrival and time had in s."""

    work: Slices[Any]
    finish: Callable[[Any], None]
    size: int
    came: float
    had: float = 0.0
    begun: bool = False

    @property
    def rank(self) -> tuple[int, int]:
        """Sort key: the shares it has had, then its size; the least is served first."""
        return int(self.had / SHARE), self.size


class Turns:
    """Serves several requests in turns.

    Parameters
    ----------
    clock : callable
        Returns the time in s.
    deadline : float
        Time in s from a request's arrival to its deadline.
    most : int
        Greatest number of concurrent requests.
    """

    def __init__(self, clock: Callable[[], float], *, deadline: float, most: int) -> None:
        self._clock, self._deadline, self._most = clock, deadline, most
        self._jobs: list[_Job] = []  # in the order of arrival
        self._given = 0  # turns since a request passed its deadline

    def __len__(self) -> int:
        """Return the number of requests under way."""
        return len(self._jobs)

    def add(self, work: Slices[Any], finish: Callable[[Any], None], *, size: int) -> bool:
        """Add a request whose result goes to `finish`; return False if there are too many already.

        Among requests that have had the same number of shares, the one with the least `size` is served first.
        """
        if len(self._jobs) >= self._most:
            return False
        self._jobs.append(_Job(work, finish, size, self._clock()))
        return True

    def work(self) -> None:
        """Work on one request for a turn; there must be one."""
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
