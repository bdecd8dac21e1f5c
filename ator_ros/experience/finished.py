"""The finished episodes of a collection, kept one by one until their table is written."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from ator_ros.experience.columns import columns
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.table import join
from ator_ros.experience.validation import checked_rows
from ator_ros.files import is_locked_elsewhere, read_text
from ator_ros.printable import short

_LARGEST = 2_000_000_000
"""Bytes of a file that is read: an episode takes about 10 kB."""


class FinishedEpisodes:
    """The episodes of a collection, one a line in a file beside the table.

    The same collection continues after them, however its process ended. The first line holds what the
    episodes depend on. A line that was cut off is dropped.

    Parameters
    ----------
    table : Path
        File of the table that the episodes will be written to.
    identity : mapping
        What the episodes depend on, as JSON can hold it.

    Attributes
    ----------
    path : Path
        The file.
    frames : dict
        The rows of each episode by action and number.

    Raises
    ------
    ExperienceError
        The file holds other episodes, is damaged, or another process writes it.
    OSError
        It cannot be written.
    """

    def __init__(self, table: Path, identity: Mapping[str, Any]) -> None:
        self.path = table.with_suffix(".episodes.jsonl")
        self.frames: dict[tuple[str, int], pd.DataFrame] = {}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        head = json.dumps(identity, sort_keys=True)
        try:
            text = read_text(self.path, _LARGEST) if self.path.exists() else ""
            lines = text.split("\n")[:-1]
            there, lines = "".join(lines[:1]), lines[1:]
            frames = [_frame_in(line) for line in lines]
            if frames:
                checked_rows(self.path, join(frames), "default")
        except (ValueError, RecursionError) as error:
            raise ExperienceError(f"{self.path}: expected episodes, one a line: {error}") from error
        if there not in ("", head):
            raise ExperienceError(
                f"{self.path}: expected episodes of the same seed, robot, domain, action set and "
                "versions, got others: choose another --out, or delete that file"
            )
        self._file = self.path.open("ab")
        if is_locked_elsewhere(self._file.fileno()):
            self._file.close()
            raise ExperienceError(f"{self.path}: expected a file of its own, another command is writing it")
        self._size = len("".join(f"{line}\n" for line in (there, *lines) if line).encode())
        os.truncate(self.path, self._size)
        if not there:
            self._append(head)
        self.frames = {(frame["action"].iloc[0], int(frame["episode"].iloc[0])): frame for frame in frames}

    def add(self, frame: pd.DataFrame) -> None:
        """Keep the rows of one more episode; raises OSError if they cannot be written."""
        row = frame.iloc[0]
        self.frames[row["action"], int(row["episode"])] = frame
        self._append(json.dumps({name: _plain(frame[name]) for name in frame.columns}))

    def _append(self, line: str) -> None:
        """Write a line whole or, where OSError is raised, not at all."""
        data = line.encode() + b"\n"
        try:
            self._file.write(data)
            self._file.flush()
        except OSError:
            os.truncate(self.path, self._size)
            raise
        self._size += len(data)

    def close(self) -> None:
        """Close the file; delete it if it holds no episode."""
        self._file.close()
        if not self.frames:
            self.remove()

    def remove(self) -> None:
        """Delete the file: the table is written."""
        self.path.unlink(missing_ok=True)


def _plain(column: pd.Series) -> Any:
    """Return the values of a column; of a constant one, its value."""
    values = column.tolist()
    constant = column.nunique(dropna=False) == 1
    return values[0] if constant else values


def _frame_in(line: str) -> pd.DataFrame:
    """Return the rows of an episode; raises ValueError if the line holds none."""
    data = json.loads(line)
    if not isinstance(data, dict) or (missing := sorted(columns(()).keys() - data.keys())):
        raise ValueError(f"{short(line)} {f'lacks {missing}' if isinstance(data, dict) else 'is no episode'}")
    if not (isinstance(data["action"], str) and type(data["episode"]) is int):
        raise ValueError(f"{short(line)}: expected a name as action and a whole number as episode")
    rows = max((len(values) for values in data.values() if isinstance(values, list)), default=1)
    return pd.DataFrame(
        {name: values if isinstance(values, list) else [values] * rows for name, values in data.items()}
    )
