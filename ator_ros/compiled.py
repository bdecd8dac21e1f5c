"""Compilation of numerical functions with numba.

Division by zero gives infinity, as in numpy. Machine code is cached on disk.
"""

from __future__ import annotations

import ast
import hashlib
import os
import shutil
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core.caching import UserProvidedCacheLocator
from numba.extending import overload, register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parent
_CACHE = _PACKAGE / "__pycache__"
# compiled code, and constants that it uses
_FOLDERS = ("world", "bases", "performance", "refinement", "domains")


def code_digest(files: Iterable[Path]) -> str:
    """Return a digest of the code of Python files, whatever their docstrings, comments and layout."""
    digest = hashlib.sha256()
    for file in files:
        tree = ast.parse(file.read_bytes())
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                node.body = [each for each in body if not _is_text(each)]  # type: ignore[attr-defined]
        digest.update(ast.dump(tree).encode())
    return digest.hexdigest()


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@cache
def _digest_of_package() -> str:
    """Return the digest of the code that compiled functions consist of.

    Parsing takes some 0.3 s, so the last digest is kept beside the machine code.
    """
    files = [
        _PACKAGE / "compiled.py",
        *sorted(file for name in _FOLDERS for file in (_PACKAGE / name).rglob("*.py")),
    ]
    text = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    kept = _CACHE / "numba.digests"
    try:
        last_text, last_code = kept.read_text(encoding="ascii").split()
        if last_text == text:
            return last_code
    except (OSError, ValueError):
        pass
    code = code_digest(files)
    try:
        _CACHE.mkdir(exist_ok=True)
        temporary = kept.with_name(f"{kept.name}.{os.getpid()}")
        temporary.write_text(f"{text} {code}", encoding="ascii")
        temporary.replace(kept)
    except OSError:  # the cache cannot be written
        pass
    return code


class CodeLocator(UserProvidedCacheLocator):  # type: ignore[misc] # numba has no type hints
    """Keeps machine code as long as no code of the package changes.

    numba itself compiles a function again if anything in its own file changes, docstrings
    included, but not if a function changes that it calls.
    """

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> CodeLocator | None:
        """Return the locator of a function of this package; None leaves others to numba."""
        if not Path(py_file).resolve().is_relative_to(_PACKAGE):
            return None
        locator: CodeLocator | None = super().from_function(py_func, py_file)
        return locator

    def get_source_stamp(self) -> str:
        """Return what replaces former machine code when it changes."""
        return _digest_of_package()

    def get_disambiguator(self) -> str:
        """Return nothing: names are unique in a file, and line numbers change with docstrings."""
        return ""


def _cache_folder() -> str:
    """Return the folder of machine code of the present sources; remove those of former sources."""
    # Variables such as NUMBA_BOUNDSCHECK change the code.
    options = sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))
    kind = hashlib.sha256(repr(options).encode()).hexdigest()[:8]
    folder = _CACHE / f"numba-{kind}-{_digest_of_package()[:16]}"
    if not folder.exists():
        for former in _CACHE.glob(f"numba-{kind}-*"):
            shutil.rmtree(former, ignore_errors=True)
    return str(folder)


if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = _cache_folder()
if not numba.config.CACHE_LOCATOR_CLASSES:
    others = "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator"
    numba.config.CACHE_LOCATOR_CLASSES = f"{CodeLocator.__module__}.{CodeLocator.__name__},{others}"


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
