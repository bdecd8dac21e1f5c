"""Machine code of compiled functions on disk: checked before it is read, and never needed to run.

numba's own cache unpickles whatever lies in its folder: an empty or truncated file ends a node with a
traceback, a damaged one with a segmentation fault, a full disk with an error at the first call. Here every
file carries the digest of its content and appears whole or not at all: what is damaged is compiled again.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import pickle
import platform
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core import compiler, serialize

from ator_ros.files import replaced

_LOG = logging.getLogger(__name__)
_DIGEST_BYTES = hashlib.sha256().digest_size
_LARGEST = 50_000_000  # bytes; the largest file of ours has some 200 kB
_PACKAGE = Path(__file__).resolve().parent
_FOLDERS = {"motion", "performance", "domains"}
"""Folders whose functions or constants are used by compiled functions of other files."""
_told: list[str] = []


class CheckedCache:
    """What a numba dispatcher asks for compiled versions of one function.

    Parameters
    ----------
    function : callable
        The function as written in Python.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._elsewhere = _digest_elsewhere(function)

    @property
    def cache_path(self) -> str:
        """The folder that is tried first, for numba's statistics."""
        return str(next(_folders(), ""))

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Read the version for argument types `signature`; None where there is none that can be used."""
        target.refresh()
        for folder in _folders():
            file = folder / self._file_name(signature, target.codegen())
            try:
                return compiler.CompileResult._rebuild(target, *pickle.loads(_checked_content(file)))  # noqa: S301
            except FileNotFoundError:
                continue
            except Exception as error:  # unpickling raises anything
                _warn_once(f"{file}: expected compiled code, got {_short(error)}: it is compiled again")
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep a version that was just compiled in the first folder that takes it."""
        if result.lifted or result.library.has_dynamic_globals:
            return
        content = serialize.dumps(result._reduce())
        problem = "no folder for it: HOME is not set"
        for folder in _folders():
            try:
                with replaced(folder / self._file_name(signature, result.codegen)) as file:
                    file.write_bytes(hashlib.sha256(content).digest() + content)
                return
            except OSError as error:
                problem = _short(error)
        _warn_once(f"compiled code cannot be kept ({problem}): it is compiled at every start")

    def _file_name(self, signature: Any, codegen: Any) -> str:
        # The triple, name and features of the CPU: code for another one would crash this one.
        words = repr((str(signature), codegen.magic_tuple())) + self._elsewhere
        return f"{self._name}-{hashlib.sha256(words.encode()).hexdigest()[:16]}.bin"

    def enable(self) -> None:
        """Do nothing: it is always on."""

    def disable(self) -> None:
        """Do nothing: it is always on."""

    def flush(self) -> None:
        """Do nothing: what is out of date lies in another folder."""


def _checked_content(file: Path) -> bytes:
    if file.stat().st_size > _LARGEST:
        raise ValueError(f"more than {_LARGEST} bytes")
    data = file.read_bytes()
    digest, content = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        raise ValueError("a damaged file")
    return content


def _folders() -> Iterator[Path]:
    """Yield the folders to look in: the user's choice, or beside the sources and then in the user's cache."""
    name = f"compiled-{_key()}"
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen) / name
        return
    yield _PACKAGE / "__pycache__" / name
    try:
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ator_ros" / name
    except RuntimeError:  # no HOME, and a user without an entry in the system's list
        return


@cache
def _key() -> str:
    """Digest everything that the machine code depends on.

    numba alone would notice a change of a function's own file, not of the functions that it calls.
    """
    digest = hashlib.sha256()
    for file in sorted(_PACKAGE.rglob("*.py")):
        if file.relative_to(_PACKAGE).parts[0] in _FOLDERS or b"@compiled" in file.read_bytes():
            digest.update(f"{file.relative_to(_PACKAGE)}\0".encode() + file.read_bytes())
    versions = (platform.python_version(), np.__version__, numba.__version__, llvmlite.__version__)
    cpu = (llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten())
    # Variables such as NUMBA_BOUNDSCHECK change the code.
    options = sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))
    digest.update(repr((versions, cpu, [item for item in options if item[0] != "NUMBA_CACHE_DIR"])).encode())
    return digest.hexdigest()[:16]


def _digest_elsewhere(function: Callable[..., Any]) -> str:
    """Digest the sources of a function of another package; empty for ours, which `_key` covers."""
    top, _, _ = function.__module__.partition(".")
    if top == __package__:
        return ""
    folders = getattr(sys.modules.get(top), "__path__", ())
    files = [file for folder in folders for file in sorted(Path(folder).rglob("*.py"))]
    digest = hashlib.sha256()
    for file in files or [Path(function.__code__.co_filename)]:
        with contextlib.suppress(OSError):  # typed in, or deleted since
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _warn_once(text: str) -> None:
    """Log the first problem of this process only: all functions have the same one."""
    if not _told:
        _told.append(text)
        _LOG.warning("ator_ros: %s", text)


def _short(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0][:200]
