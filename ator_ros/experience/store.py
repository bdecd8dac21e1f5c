"""A bounded store of episodes on disk; a node appends while others read.

    FOLDER/store.json                      of which robot and domain
    FOLDER/default/000000.jsonl ...        parts of an action set: one episode a line

A killed process loses no appended episode, see `JsonLines`; `sync` protects against a loss of power.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.episode import Episode
from ator_ros.experience.json_lines import JsonLines
from ator_ros.experience.table import (
    Experience,
    ExperienceError,
    checked_rows,
    join,
    library_versions,
    start_row,
)
from ator_ros.files import FileError, is_name, load, save

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

    One process at a time may append: see `ator_ros.files.exclusive_folder`.

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
    FileError
        The folder is a store of another robot or domain.
    OSError
        It cannot be written.
    """

    def __init__(self, folder: Path, info: StoreInfo, *, most: int) -> None:
        self._folder, self._most = folder, most
        folder.mkdir(parents=True, exist_ok=True)
        if not is_store(folder):
            save(folder / STORE, KIND, info)
        elif (there := load(folder / STORE, KIND, StoreInfo)) != info:
            raise FileError(f"{folder / STORE}: expected {info}, got {there}: choose another folder")
        self._parts = {name: max(_parts_of(folder / name)) for name in action_sets_in(folder)}
        self._files = {name: self._open(name, number) for name, number in self._parts.items()}
        self._unsynced: set[str] = set()

    @property
    def ends(self) -> dict[str, int]:
        """The number that the next episode of each action set gets; numbers are never used twice."""
        return {name: self._parts[name] * PART + file.count for name, file in self._files.items()}

    def append(self, action_set: str, episode: Episode) -> None:
        """Append an episode; it is written whole or, when OSError is raised, not at all."""
        if action_set not in self._files:
            self._begin_part(action_set, 0)
        elif (full := self._files[action_set]).count >= PART:
            full.sync()
            self._begin_part(action_set, self._parts[action_set] + 1)
            full.close()
        row = {name: None if value != value else value for name, value in start_row(episode).items()}  # NaN
        self._files[action_set].append(row)
        self._unsynced.add(action_set)

    def _begin_part(self, action_set: str, number: int) -> None:
        """Begin a part; drop those that are too old."""
        self._files[action_set] = self._open(action_set, number)
        self._parts[action_set] = number
        for older, file in _parts_of(self._folder / action_set).items():
            if older < number - math.ceil(self._most / PART):
                file.unlink()

    def _open(self, action_set: str, number: int) -> JsonLines:
        return JsonLines(self._folder / action_set / f"{number:06d}.jsonl")

    def sync(self) -> None:
        """Flush appended episodes to the disk."""
        for action_set in self._unsynced:
            self._files[action_set].sync()
        self._unsynced.clear()

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()
        self._files.clear()


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
    FileError
        `folder` is no store.
    ExperienceError
        It holds no episodes of the set.
    """
    info = load(folder / STORE, KIND, StoreInfo)
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
        frame = _checked(file, rows, action_set)
        if frame is None:  # leave out the lines that are no episodes
            rows = [row for row in rows if _checked(file, [row], action_set) is not None]
            frame = _checked(file, rows, action_set)
        damaged += len(lines) - len(rows)
        if frame is not None:
            frames.append(frame)
            numbers.append(number * PART + frame["episode"].to_numpy(dtype=np.int64))
    joined = join(frames)
    joined["episode"] = np.arange(len(joined), dtype=np.int32)
    joined[NUMBER] = np.concatenate(numbers) if numbers else np.empty(0, dtype=np.int64)
    return StoredRecords(joined, damaged)


def _row(line: bytes, number: int) -> dict[str, Any] | None:
    """Return the columns of a line, with its number as `episode`; None if the line is damaged."""
    try:
        row = json.loads(line)
        return {**{name: math.nan if row[name] is None else row[name] for name in row}, "episode": number}
    except (ValueError, TypeError, RecursionError):
        return None


def _checked(file: Path, rows: list[dict[str, Any]], action_set: str) -> pd.DataFrame | None:
    """Return lines as checked rows of experience; None if there are none, or if one is no episode."""
    try:
        return checked_rows(file, pd.DataFrame(rows), action_set)
    except (ValueError, TypeError, OverflowError):  # ExperienceError among them
        return None
