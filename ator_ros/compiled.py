"""Compilation of number-crunching functions with numba, where it is installed.

rosdep has no key for numba on Ubuntu 24.04, so nodes must run without it: then `compiled` leaves functions as
they are, with the same results, some hundred times slower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

try:
    import numba
except ImportError:
    numba = None
else:
    from ator_ros.compile_cache import CheckedCache

COMPILES = numba is not None
"""Whether numba is there."""


def compiled(function: Function) -> Function:
    """Compile `function` at its first call; the machine code is kept on disk for the next process.

    Division by zero gives infinity, as in numpy; nothing else is relaxed, so results stay the same to the
    last bit whoever asks.
    """
    if not COMPILES:
        return function
    result: Function = numba.njit(error_model="numpy")(function)
    if not numba.config.DISABLE_JIT:
        # numba has no public way to bring a cache of one's own.
        result._cache = CheckedCache(function)  # type: ignore[attr-defined]
    return result
