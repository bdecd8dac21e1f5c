"""Compilation of number-crunching functions with numba, where it is installed.

rosdep has no key for numba on Ubuntu 24.04, so nodes must run without it: then `compiled` leaves functions as
they are, with the same results, some hundred times slower.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

try:
    import numba
except ImportError:
    numba = None

COMPILES = numba is not None
"""Whether numba is there."""


def compiled(function: Function) -> Function:
    """Compile `function` at its first call; what was compiled is kept on disk for the next process.

    Division by zero gives infinity, as in numpy; nothing else is relaxed, so results stay the same to the
    last bit whoever asks.
    """
    if not COMPILES:
        return function
    try:
        result: Function = numba.njit(cache=True, error_model="numpy")(function)
    except (OSError, RuntimeError):  # nowhere to keep it
        result = numba.njit(error_model="numpy")(function)
    return result


def _cache_folder() -> Path:
    """Give the folder of what was compiled from the package as it is now.

    numba alone would notice a change of the function's own file only, not of the functions that it calls.
    """
    package = Path(__file__).resolve().parent
    digest = hashlib.sha256(numba.__version__.encode())
    for file in sorted(package.glob("performance/*.py")):
        digest.update(file.read_bytes())
    beside = package / "__pycache__"
    if not os.access(beside if beside.exists() else package, os.W_OK):
        beside = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ator_ros"
    return beside / f"compiled-{digest.hexdigest()[:16]}"


if COMPILES and not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = str(_cache_folder())
