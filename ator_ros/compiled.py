"""Compilation of numerical functions with numba.

Division by zero gives infinity, as in numpy. Machine code is cached on disk.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.extending import overload, register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


def _cache_folder() -> str:
    """Return a cache folder for the machine code of these sources.

    numba itself detects changes in a function's own file only, not in the functions that it calls.
    """
    package = Path(__file__).resolve().parent
    # Compiled code, and constants that it uses
    folders = ("world", "motion", "performance", "refinement", "domains")
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for file in sorted(file for name in folders for file in (package / name).rglob("*.py")):
        digest.update(file.read_bytes())
    # Variables such as NUMBA_BOUNDSCHECK change the code.
    digest.update(
        repr(sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))).encode()
    )
    return str(package / "__pycache__" / f"numba-{digest.hexdigest()[:16]}")


if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = _cache_folder()


def is_cached() -> bool:
    """Return whether a process has already compiled functions of these sources."""
    return any(Path(numba.config.CACHE_DIR).rglob("*.nbi"))


def compiled(function: Function, **options: bool) -> Function:
    """Return `function` compiled at its first call."""
    try:
        result: Function = numba.njit(error_model="numpy", cache=True, **options)(function)
    except RuntimeError:  # the cache cannot be written
        result = numba.njit(error_model="numpy", **options)(function)
    return result


def inlined(function: Function) -> Function:
    """Return `function` compiled into its callers: passing many arguments would take longer than the call."""
    return compiled(function, forceinline=True)


def elementwise(function: Function) -> Function:
    """Return `function` compiled for compiled callers only; Python calls it with arrays of any shape.

    Compiling each combination of shapes would take seconds, and numpy is as fast with arrays. The
    results are bitwise equal.
    """
    result: Function = register_jitable(error_model="numpy")(function)
    return result


def least(one: Any, other: Any) -> Any:
    """Return the lesser of two numbers; of arrays, elementwise."""
    return np.minimum(one, other)


def greatest(one: Any, other: Any) -> Any:
    """Return the greater of two numbers; of arrays, elementwise."""
    return np.maximum(one, other)


def where(which: Any, one: Any, other: Any) -> Any:
    """Return `one` where `which` holds, else `other`."""
    return np.where(which, one, other)[()]  # a number if all are numbers


# Unlike numpy's functions, these forms allow compiled loops to be vectorized.
overload(least)(lambda one, other: lambda one, other: min(one, other))  # noqa: ARG005
overload(greatest)(lambda one, other: lambda one, other: max(one, other))  # noqa: ARG005
overload(where)(lambda which, one, other: lambda which, one, other: one if which else other)  # noqa: ARG005
