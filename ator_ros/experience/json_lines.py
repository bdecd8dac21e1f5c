"""Files of JSON objects, one a line, that lose no line when their process is killed."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from ator_ros.files import FileError, try_lock


class JsonLines:
    """A file to which this process appends, unbuffered.

    Parameters
    ----------
    path : Path
        The file; made when missing, with its folder. A last line that was cut off is dropped.
    locked : bool
        Whether to lock it against other processes until it is closed.

    Attributes
    ----------
    lines : list of bytes
        The lines that were there.
    count : int
        Number of lines.

    Raises
    ------
    FileError
        The file is locked by another process.
    OSError
        The file cannot be written.
    """

    def __init__(self, path: Path, *, locked: bool = False) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("ab", buffering=0)
        if locked and not try_lock(self._file.fileno()):
            self._file.close()
            raise FileError(f"{path}: expected a file of its own, another command is writing it")
        *self.lines, cut_off = path.read_bytes().split(b"\n")
        self.count, self._size = len(self.lines), path.stat().st_size - len(cut_off)
        self._file.truncate(self._size)

    def append(self, row: Mapping[str, Any]) -> None:
        """Append an object; it is written whole or, when OSError is raised, not at all."""
        line = json.dumps(row, separators=(",", ":")).encode() + b"\n"
        try:
            if self._file.write(line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            self._file.truncate(self._size)
            raise
        self._size, self.count = self._size + len(line), self.count + 1

    def sync(self) -> None:
        """Flush appended lines to the disk, which protects them against a loss of power."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class PartialResults(JsonLines):
    """Results of a computation, which can resume with them; the first line holds what they depend on.

    Parameters
    ----------
    path : Path
        The file.
    identity : mapping
        What the results depend on, as JSON can hold it.
    expected : str
        What the file holds, for messages, as in "episodes of the same seed".

    Attributes
    ----------
    results : list of dict
        The results of earlier runs.

    Raises
    ------
    FileError
        The file holds other results, is damaged, or is locked by another process.
    OSError
        The file cannot be written.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], expected: str) -> None:
        super().__init__(path, locked=True)
        try:
            there = [dict(json.loads(line)) for line in self.lines]
        except (TypeError, ValueError) as error:
            raise FileError(f"{path}: expected {expected}, one a line: {error}") from error
        if not there:
            self.append(identity)
        elif there[0] != json.loads(json.dumps(identity)):
            raise FileError(
                f"{path}: expected {expected}, got others: choose another --out, or delete that file"
            )
        self.results: list[dict[str, Any]] = there[1:]

    def __enter__(self) -> Self:
        """Return this object, whose file is closed when the block ends."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file; delete it if it holds no result."""
        self.close()
        if self.count == 1:
            self.path.unlink()
