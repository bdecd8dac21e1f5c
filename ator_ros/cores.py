"""Computations that are shared by several cores: long compiled loops, and calls that do not need each other.

Each item is computed on its own, so results do not depend on how items are shared. By default nothing is:
tools start a process for each core instead. A node that answers requests one by one calls `use_cores`.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from ator_ros.compiled import compiles

Result = TypeVar("Result")


class _Helpers:
    """The threads that take shares beside the caller's."""

    def __init__(self) -> None:
        self.count = 0
        self._pool: ThreadPoolExecutor | None = None

    def become(self, count: int) -> None:
        """End the present threads, and have `count` new ones, which start when they are needed."""
        former, self.count = self._pool, count
        self._pool = ThreadPoolExecutor(count, thread_name_prefix="cores") if count else None
        if former is not None:
            former.shutdown(wait=False)

    def start(self, work: Callable[[], None]) -> list[Future[None]]:
        """Let all threads do `work`; those that are being replaced need not."""
        pool = self._pool
        if pool is None:
            return []
        started: list[Future[None]] = []
        with contextlib.suppress(RuntimeError):  # of a pool that was shut down meanwhile
            started.extend(pool.submit(work) for _ in range(self.count))
        return started

    def forget(self) -> None:
        """Have no threads: a forked process has none of its parent's."""
        self.count, self._pool = 0, None


_helpers = _Helpers()
os.register_at_fork(after_in_child=_helpers.forget)


def use_cores(most: int) -> int:
    """Share loops among `most` cores from now on, or among as many as the process may use; return how many.

    Without numba nothing is shared, since Python's lock lets one core work at a time.
    """
    count = max(1, min(most, len(os.sched_getaffinity(0)))) if compiles() else 1
    _helpers.become(count - 1)
    return count


def in_shares(run: Callable[[int, int], None], count: int, least: int) -> None:
    """Call `run(first, end)` for shares of `count` items, on all cores that may be used.

    Parameters
    ----------
    run : callable
        Computes the items from `first` to `end`. It must be compiled with `ator_ros.compiled.unlocked`, else
        one core waits for the other.
    count, least : int
        How many items there are, and the fewest in a share. Fewer than three shares are not worth the time
        that it takes to wake up another core.

    Notes
    -----
    Who is free takes the next share. A core that is busy with something else delays nothing but the share
    that it has taken.
    """
    if not _helpers.count or count < 3 * least:
        run(0, count)
        return
    size = max(least, -(-count // (4 * _helpers.count)))
    starts = iter(range(0, count, size))  # taking the next one is atomic

    def work() -> None:
        for first in starts:
            run(first, min(first + size, count))

    _on_all_cores(work)


def together(calls: Sequence[Callable[[], Result]]) -> list[Result]:
    """Return what calls return, in their order, made on all cores that may be used.

    Where calls fail, the error of the first of them is raised, as if they had been made one after the other.

    Parameters
    ----------
    calls : sequence of callable
        None needs what another one does. What they compute must be mostly compiled, as in `in_shares`.
    """
    if not _helpers.count or len(calls) < 2:
        return [call() for call in calls]
    results: dict[int, Result] = {}
    errors: dict[int, BaseException] = {}
    numbers = iter(range(len(calls)))  # taking the next one is atomic

    def work() -> None:
        for number in numbers:
            try:
                results[number] = calls[number]()
            except BaseException as error:  # raised below
                errors[number] = error
            if errors:
                return

    _on_all_cores(work)
    if errors:
        raise errors[min(errors)]
    return [results[number] for number in range(len(calls))]


def _on_all_cores(work: Callable[[], None]) -> None:
    """Do `work` here and on every core that may be used, until all of them have done it."""
    others = _helpers.start(work)
    try:
        work()
    finally:
        begun = [other for other in others if not other.cancel()]
        for other in begun:
            other.exception()  # waits: they write into what the caller has
    for other in begun:
        other.result()
