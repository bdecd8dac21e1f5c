"""Compilation of numerical functions with numba, and parallel loops.

Division by zero gives infinity, as in numpy. Machine code is cached on disk.
"""

from __future__ import annotations

import hashlib
import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


def _cache_folder() -> str:
    """Return the cache folder for the machine code of these sources.

    numba itself notices changes of a function's own file only, not of the functions that it calls.
    """
    package = Path(__file__).resolve().parent
    # The last three contain compiled code, which uses constants of `world`.
    folders = ("world", "motion", "performance", "domains")
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for file in sorted(file for name in folders for file in (package / name).rglob("*.py")):
        digest.update(file.read_bytes())
    # Variables such as NUMBA_BOUNDSCHECK change the code.
    digest.update(repr(sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))).encode())
    return str(package / "__pycache__" / f"numba-{digest.hexdigest()[:16]}")


if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = _cache_folder()


def compiled(function: Function, **options: bool) -> Function:
    """Compile `function` at its first call."""
    try:
        made: Function = numba.njit(error_model="numpy", cache=True, **options)(function)
    except RuntimeError:  # no folder can be written
        made = numba.njit(error_model="numpy", **options)(function)
    return made


def inlined(function: Function) -> Function:
    """Compile `function` into its callers: passing many arguments would take longer than the function."""
    return compiled(function, forceinline=True)


def unlocked(function: Function) -> Function:
    """Compile `function` to run without the GIL, in parallel with other threads."""
    return compiled(function, nogil=True)


def elementwise(function: Function) -> Function:
    """Compile `function` for compiled callers only; Python calls it with numpy arrays of any shape.

    Compiling each combination of shapes would take seconds, and numpy is as fast with arrays. The results
    are bitwise equal.
    """
    made: Function = register_jitable(error_model="numpy")(function)
    return made


_pools: list[ThreadPoolExecutor] = []
"""The worker threads of `parallel_for`, if there are any."""
_CHUNKS = 16  # greatest number: a core that is done takes the next one


def use_cores(most: int) -> int:
    """Run `parallel_for` on up to `most` cores from now on; return how many there are.

    The default is one core, because tools start a process for each core.
    """
    count = max(1, min(most, len(os.sched_getaffinity(0))))
    _pools[:] = [ThreadPoolExecutor(count)] if count > 1 else []
    return count


def parallel_for(run: Callable[[int, int], None], count: int, least: int) -> None:
    """Call `run(first, end)` for chunks of `count` items, on all cores of `use_cores`.

    Parameters
    ----------
    run : callable
        Computes the items from `first` to `end`; compiled with `unlocked`, otherwise nothing runs in
        parallel. Items are independent, so results do not depend on the chunks.
    count, least : int
        Number of items, and least number per chunk. Fewer than three chunks run on one core, since waking a
        thread takes longer.
    """
    if not _pools or count < 3 * least:
        run(0, count)
        return
    size = max(least, -(-count // _CHUNKS))
    starts = range(0, count, size)
    deque(_pools[0].map(run, starts, (min(first + size, count) for first in starts)), maxlen=0)
