"""A bounded store of episodes on disk; a node appends while others read.

    FOLDER/store.json                      of which robot and domain
    FOLDER/default/000000.jsonl ...        parts of an action set: one episode a line

Each line is written unbuffered, so that a killed process loses no appended episode; `sync` protects against
a loss of power. A cut-off last line is dropped when the store is opened again.
"""

from __future__ import annotations

import errno
import json
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.goal_variables import MOST_GOAL_VARIABLES, direct_name
from ator_ros.experience.columns import (
    MOST_OBJECTS,
    ExperienceError,
    columns,
    goal_variables_of_columns,
    object_columns,
    objects_of_columns,
)
from ator_ros.experience.episode import Episode
from ator_ros.experience.table import Experience, checked_rows, join, library_versions, start_row
from ator_ros.files import is_name, load, save

KIND = "record store"
STORE = "store.json"
PART = 1000
"""Episodes of a part, the unit that is dropped when the store is full."""
NUMBER = "number"
"""Column of the numbers of episodes, which increase with time and are never used twice."""
_NUMBER = re.compile(r"(\d{6,})\.jsonl")


@dataclass(frozen=True)
class StoreInfo:
    """The fields of store.json: robot and domain of all episodes."""

    robot_digest: str
    domain: str


def _parts_of(place: Path) -> dict[int, Path]:
    """Return the parts of an action set by number, in order."""
    files = place.glob("*.jsonl")  # empty if the folder is missing
    found = {int(match[1]): file for file in files if (match := _NUMBER.fullmatch(file.name))}
    return dict(sorted(found.items()))


class RecordStore:
    """Appends episodes; the oldest ones are dropped if the store is full.

    One process at a time may append: see `ator_ros.learning.sets.locked`.

    Parameters
    ----------
    folder : Path
        Made when missing.
    info : StoreInfo
        Robot and domain of the episodes.
    most : int
        Episodes of each action set that are kept, and up to a part more.

    Raises
    ------
    ExperienceError
        The folder is a store of another robot or domain.
    OSError
        It cannot be written.
    """

    def __init__(self, folder: Path, info: StoreInfo, *, most: int) -> None:
        self._folder, self._most = folder, most
        folder.mkdir(parents=True, exist_ok=True)
        if not is_store(folder):
            save(folder / STORE, KIND, info)
        elif (there := load(folder / STORE, KIND, StoreInfo, error=ExperienceError)) != info:
            raise ExperienceError(f"{folder / STORE}: expected {info}, got {there}: choose another folder")
        places = [folder / name for name in action_sets_in(folder)]
        self._parts = {place.name: _Part(place, max(_parts_of(place))) for place in places}

    @property
    def ends(self) -> dict[str, int]:
        """The number that the next episode of each action set gets; numbers are never used twice."""
        return {name: part.number * PART + part.lines for name, part in self._parts.items()}

    def append(self, action_set: str, episode: Episode) -> None:
        """Append an episode; it is written whole or, when OSError is raised, not at all."""
        place, part = self._folder / action_set, self._parts.get(action_set)
        if part is None:
            place.mkdir(exist_ok=True)
            part = self._parts[action_set] = _Part(place, 0)
        elif part.lines >= PART:
            part.sync()
            full, part = part, _Part(place, part.number + 1)
            self._parts[action_set] = part
            full.close()
            kept = math.ceil(self._most / PART)
            for number, file in _parts_of(place).items():
                if number < part.number - kept:
                    file.unlink()
        row = {name: None if value != value else value for name, value in start_row(episode).items()}  # NaN
        part.append(json.dumps(row, allow_nan=False, separators=(",", ":")).encode() + b"\n")

    def sync(self) -> None:
        """Flush appended episodes to the disk."""
        for part in self._parts.values():
            part.sync()

    def close(self) -> None:
        """Close the files."""
        for part in self._parts.values():
            part.close()
        self._parts.clear()


class _Part:
    """The newest part of an action set, open for appending."""

    def __init__(self, place: Path, number: int) -> None:
        self.number, self._dirty = number, False
        file = place / f"{number:06d}.jsonl"
        self._handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        lines = file.read_bytes().split(b"\n")
        self.lines = len(lines) - 1
        self._size = file.stat().st_size - len(lines[-1])
        os.ftruncate(self._handle, self._size)  # drop a cut-off line

    def append(self, line: bytes) -> None:
        try:
            if os.write(self._handle, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            os.ftruncate(self._handle, self._size)
            raise
        self._size, self.lines, self._dirty = self._size + len(line), self.lines + 1, True

    def sync(self) -> None:
        if self._dirty:
            os.fsync(self._handle)
            self._dirty = False

    def close(self) -> None:
        os.close(self._handle)


@dataclass(frozen=True)
class StoredRecords:
    """The episodes of one action set in a store.

    Attributes
    ----------
    rows : pandas.DataFrame
        The starts of the episodes, oldest first, with the columns of a table and `NUMBER`.
    damaged : int
        Lines that could not be read, and were left out.
    """

    rows: pd.DataFrame
    damaged: int


def is_store(path: Path) -> bool:
    """Return whether `path` is the folder of a store."""
    return (path / STORE).is_file()


def action_sets_in(folder: Path) -> list[str]:
    """Return the action sets with episodes in a store."""
    places = [place for place in folder.iterdir() if place.is_dir() and is_name(place.name)]
    return sorted(place.name for place in places if _parts_of(place))


def read_store(folder: Path, action_set: str | None = None) -> Experience:
    """Read the episodes of an action set as experience.

    Parameters
    ----------
    folder : Path
        Of the store.
    action_set : str, optional
        Name of the set; by default the only one of the store.

    Raises
    ------
    ExperienceError
        `folder` is no store, or holds no episodes of the set.
    """
    info = load(folder / STORE, KIND, StoreInfo, error=ExperienceError)
    there = action_sets_in(folder)
    if action_set is None and len(there) > 1:
        raise ExperienceError(f"{folder}: expected --action-set, one of {', '.join(there)}")
    name = action_set or (there[0] if there else DEFAULT_SET)
    stored = read_records(folder, name)
    if stored.rows.empty:
        raise ExperienceError(f"{folder}: expected episodes of the action set {name}, found none")
    metadata = {
        "seed": None,
        "robot_digest": info.robot_digest,
        "domain": info.domain,
        "action_set": name,
        "command": "learning",
        "versions": library_versions(),
        "records_left_out": stored.damaged,
    }
    return Experience(stored.rows.drop(columns=NUMBER), metadata)


def read_records(folder: Path, action_set: str) -> StoredRecords:
    """Read all episodes of an action set; damaged lines are left out and counted."""
    frames: list[pd.DataFrame] = []
    numbers: list[np.ndarray] = []
    damaged = 0
    for number, file in _parts_of(folder / action_set).items():
        try:
            lines = file.read_bytes().split(b"\n")[:-1]
        except FileNotFoundError:  # dropped in the meantime
            continue
        rows = [row for n, line in enumerate(lines) if (row := _row(line, n)) is not None]
        frame = _frame(file, rows, action_set)
        if frame is None:  # leave out the lines that are no episodes
            rows = [row for row in rows if _frame(file, [row], action_set) is not None]
            frame = _frame(file, rows, action_set)
        damaged += len(lines)
        if frame is not None:
            damaged -= len(frame)
            frames.append(frame)
            numbers.append(number * PART + frame["episode"].to_numpy(dtype=np.int64))
    joined = join(frames)
    joined["episode"] = np.arange(len(joined), dtype=np.int32)
    joined[NUMBER] = np.concatenate(numbers) if numbers else np.empty(0, dtype=np.int64)
    return StoredRecords(joined, damaged)


def _row(line: bytes, number: int) -> dict[str, object] | None:
    """Return the columns of a line, with its number as `episode`; None if the line is damaged."""
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return None
    whole = isinstance(row, dict) and columns(()).keys() - {"episode"} <= row.keys()
    return {**row, "episode": number} if whole else None


def _frame(file: Path, rows: list[dict[str, object]], action_set: str) -> pd.DataFrame | None:
    """Return lines as checked rows of experience; None if there are none, or if one is no episode."""
    objects = tuple(dict.fromkeys(name for row in rows for name in objects_of_columns(row)))
    declared = tuple(dict.fromkeys(name for row in rows for name in goal_variables_of_columns(row)))
    few = len(objects) <= MOST_OBJECTS and len(declared) <= MOST_GOAL_VARIABLES
    if not (few and all(map(is_name, (*objects, *declared)))):
        return None
    frame = pd.DataFrame(rows, columns=list(columns(objects, declared)))
    numbers = {*object_columns(objects), *map(direct_name, declared), "position_error", "heading_error"}
    try:
        # All of these may be null.
        return checked_rows(file, frame.astype(dict.fromkeys(numbers, float)), action_set)
    except (ValueError, TypeError, OverflowError):  # ExperienceError among them
        return None
