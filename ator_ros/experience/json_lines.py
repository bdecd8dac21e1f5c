"""Partial results of a computation in a file of JSON objects, one a line, to resume it."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from ator_ros.files import FileError, try_lock


class PartialResults:
    """The partial results of a computation; `results` are those of earlier runs.

    Parameters
    ----------
    path : Path
        The file; created if missing, with its folder. A last line that was cut off is removed.
    identity : mapping
        Settings that the results depend on, in JSON types: the first line of the file.
    expected : str
        Contents of the file, for messages, as in "episodes of the same seed".

    Raises
    ------
    FileError
        The file holds other results, is damaged, or is locked by another process.
    OSError
        The file cannot be written.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], expected: str) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("ab", buffering=0)
        if not try_lock(self._file.fileno()):
            self._file.close()
            raise FileError(f"{path}: expected a file of its own, another command is writing it")
        *lines, cut_off = path.read_bytes().split(b"\n")
        self._file.truncate(path.stat().st_size - len(cut_off))
        try:
            rows = [dict(json.loads(line)) for line in lines]
        except (RecursionError, TypeError, ValueError) as error:
            raise FileError(f"{path}: expected {expected}, one a line: {error}") from error
        self._has_results = len(rows) > 1
        if not rows:
            self._write(identity)
        elif rows[0] != json.loads(json.dumps(identity)):
            raise FileError(
                f"{path}: expected {expected}, got others: choose another --out, "
                "or delete that file"
            )
        self.results: list[dict[str, Any]] = rows[1:]

    def append(self, result: Mapping[str, Any]) -> None:
        """Append a result; it is kept if the process is killed."""
        self._write(result)
        self._has_results = True

    def _write(self, row: Mapping[str, Any]) -> None:
        line = json.dumps(row, separators=(",", ":")).encode() + b"\n"
        if self._file.write(line) < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file; delete it if it holds no result."""
        self._file.close()
        if not self._has_results:
            self.path.unlink()
