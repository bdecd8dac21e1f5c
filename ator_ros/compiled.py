"""Compilation of number-crunching functions with numba, and loops that several cores share.

Division by zero gives infinity, as in numpy; nothing else is relaxed. Machine code is kept on disk for the
next process.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


def _cache_folder() -> str:
    """Return the folder for the machine code of these sources.

    numba alone notices a change of a function's own file, not of the functions that it calls.
    """
    package = Path(__file__).resolve().parent
    # Compiled code is in the last three; `world` has constants that it contains.
    folders = ("world", "motion", "performance", "domains")
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for file in sorted(file for name in folders for file in (package / name).rglob("*.py")):
        digest.update(file.read_bytes())
    # Variables such as NUMBA_BOUNDSCHECK change the code.
    digest.update(repr(sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))).encode())
    return str(package / "__pycache__" / f"numba-{digest.hexdigest()[:16]}")


if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = _cache_folder()


def _compiled(function: Function, **options: bool) -> Function:
    try:
        made: Function = numba.njit(error_model="numpy", cache=True, **options)(function)
    except RuntimeError:  # no folder can be written
        made = numba.njit(error_model="numpy", **options)(function)
    return made


def compiled(function: Function) -> Function:
    """Compile `function` at its first call."""
    return _compiled(function)


def inlined(function: Function) -> Function:
    """Compile `function` into each place that calls it: handing over many arguments takes longer than it."""
    return _compiled(function, forceinline=True)


def unlocked(function: Function) -> Function:
    """Compile `function` to run without Python's lock, so that other threads run meanwhile."""
    return _compiled(function, nogil=True)


def elementwise(function: Function) -> Function:
    """Compile `function` for compiled code that calls it; from Python it is numpy's, for arrays of any shape.

    To compile it for each combination of shapes would take seconds for each, and numpy is as fast with
    arrays. The results are the same to the last bit.
    """
    made: Function = register_jitable(error_model="numpy")(function)
    return made


class _Cores:
    """The threads that take shares beside the caller's."""

    count = 1
    pool: ThreadPoolExecutor | None = None


def use_cores(most: int) -> int:
    """Share loops among `most` cores from now on, or among as many as the process may use; return how many.

    By default nothing is shared: tools start a process for each core instead.
    """
    _Cores.count = max(1, min(most, len(os.sched_getaffinity(0))))
    _Cores.pool = ThreadPoolExecutor(_Cores.count - 1) if _Cores.count > 1 else None
    return _Cores.count


def in_shares(run: Callable[[int, int], None], count: int, least: int) -> None:
    """Call `run(first, end)` for shares of `count` items, on all cores that may be used.

    Parameters
    ----------
    run : callable
        Computes the items from `first` to `end`. It must be compiled with `unlocked`, else one core waits for
        the other.
    count, least : int
        How many items there are, and the fewest in a share. Fewer than three shares are not worth the time
        that it takes to wake up another core.

    Notes
    -----
    Each item is computed on its own, so results do not depend on how items are shared. Whichever core is free
    takes the next share: a busy core delays nothing but the share that it has taken.
    """
    if _Cores.pool is None or count < 3 * least:
        run(0, count)
        return
    size = max(least, -(-count // (4 * (_Cores.count - 1))))
    starts = iter(range(0, count, size))  # taking the next one is atomic

    def work() -> None:
        for first in starts:
            run(first, min(first + size, count))

    others = [_Cores.pool.submit(work) for _ in range(_Cores.count - 1)]
    work()
    for other in others:
        if not other.cancel():
            other.result()
