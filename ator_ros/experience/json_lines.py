"""Results of a computation in a file of JSON objects, one a line, from which it can be resumed."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from ator_ros.files import FileError, try_lock


class PartialResults:
    """Results of a computation, which can resume with them; the first line holds what they depend on.

    Parameters
    ----------
    path : Path
        The file; made when missing, with its folder. A last line that was cut off is dropped.
    identity : mapping
        What the results depend on, as JSON can hold it.
    expected : str
        What the file holds, for messages, as in "episodes of the same seed".

    `results` are those of earlier runs.

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
            there = [dict(json.loads(line)) for line in lines]
        except (TypeError, ValueError) as error:
            raise FileError(f"{path}: expected {expected}, one a line: {error}") from error
        self._has_results = len(there) > 1
        if not there:
            self._write(identity)
        elif there[0] != json.loads(json.dumps(identity)):
            raise FileError(
                f"{path}: expected {expected}, got others: choose another --out, or delete that file"
            )
        self.results: list[dict[str, Any]] = there[1:]

    def append(self, result: Mapping[str, Any]) -> None:
        """Append a result, which a killed process does not lose."""
        self._write(result)
        self._has_results = True

    def _write(self, row: Mapping[str, Any]) -> None:
        line = json.dumps(row, separators=(",", ":")).encode() + b"\n"
        if self._file.write(line) < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))

    def __enter__(self) -> Self:
        """Return this object, whose file is closed when the block ends."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file; delete it if it holds no result."""
        self._file.close()
        if not self._has_results:
            self.path.unlink()
