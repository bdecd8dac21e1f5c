"""Compilation of number-crunching functions with numba, where it is installed.

rosdep has no key for numba on Ubuntu 24.04, so nodes must run without it: then `compiled` leaves functions as
they are, with the same results, some hundred times slower. numba takes long to import, and ``--help`` needs
none: it is imported when the first function is called, or by `compiles`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


@functools.cache
def compiles() -> bool:
    """Import numba, and return whether it is there."""
    try:
        import numba  # noqa: F401
    except ImportError:
        return False
    return True


def compiled(function: Function) -> Function:
    """Compile `function` at its first call; the machine code is kept on disk for the next process.

    Division by zero gives infinity, as in numpy; nothing else is relaxed, so results stay the same to the
    last bit whoever asks.
    """
    return _Compiled(function)  # type: ignore[return-value]


def inlined(function: Function) -> Function:
    """Compile `function` into each place that calls it: handing over many arguments takes longer than it."""
    return _Compiled(function, forceinline=True)  # type: ignore[return-value]


def unlocked(function: Function) -> Function:
    """Compile `function` to run without Python's lock, so that other threads run meanwhile."""
    return _Compiled(function, nogil=True)  # type: ignore[return-value]


def elementwise(function: Function) -> Function:
    """Compile `function` for compiled code that calls it; from Python it is numpy's, for arrays of any shape.

    To compile it for each combination of shapes would take seconds for each, and numpy is as fast with
    arrays. The results are the same to the last bit.
    """
    return _Elementwise(function)  # type: ignore[return-value]


class _Compiled:
    """A function that becomes numba's dispatcher when it is called, or named by another compiled function."""

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        functools.update_wrapper(self, function)
        self._options = options

    def __call__(self, *values: Any) -> Any:
        return self.dispatcher(*values)

    def __reduce__(self) -> str:
        return str(vars(self)["__qualname__"])  # another process finds it by its name

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The compiled function; the Python function without numba."""
        function: Callable[..., Any] = vars(self)["__wrapped__"]
        if not compiles():
            return function
        import numba

        from ator_ros.compile_cache import CheckedCache

        result = numba.njit(error_model="numpy", **self._options)(function)
        if not numba.config.DISABLE_JIT:
            # numba has no public way to bring a cache of one's own.
            result._cache = CheckedCache(function)
        return result

    @property
    def _numba_type_(self) -> Any:
        """Return the Numba type of the dispatcher."""
        return self.dispatcher._numba_type_


class _Elementwise(_Compiled):
    """A function that is compiled for compiled functions only."""

    def __call__(self, *values: Any) -> Any:
        return vars(self)["__wrapped__"](*values)
