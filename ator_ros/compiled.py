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


def elementwise(function: Function) -> Function:
    """Compile `function` for compiled callers only; Python calls it with numpy arrays of any shape.

    Compiling each combination of shapes would take seconds, and numpy is as fast with arrays. The results
    are bitwise equal.
    """
    made: Function = register_jitable(error_model="numpy")(function)
    return made
