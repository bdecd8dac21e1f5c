"""A bounded store of episodes, FOLDER/records.db: a node appends while others read.

It is an SQLite database: a process that is killed loses no appended episode.
"""

from __future__ import annotations

import errno
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.episode import Episode
from ator_ros.experience.table import Experience, ExperienceError, checked_rows, episode_frame, join
from ator_ros.files import FileError

STORE = "records.db"
NUMBER = "number"
"""Column of the numbers of episodes, which increase with time and are never used twice."""
_TABLES = """
PRAGMA journal_mode = WAL;
CREATE TABLE IF NOT EXISTS source (robot_digest TEXT, domain TEXT);
CREATE TABLE IF NOT EXISTS episodes (number INTEGER PRIMARY KEY AUTOINCREMENT, action_set TEXT, row TEXT);
CREATE INDEX IF NOT EXISTS by_set ON episodes (action_set, number);
"""
_SOURCE = "SELECT robot_digest, domain FROM source"
_APPEND = "INSERT INTO episodes (action_set, row) VALUES (:set, :row)"
_DROP_OLDEST = """
DELETE FROM episodes WHERE action_set = :set AND number <=
(SELECT number FROM episodes WHERE action_set = :set ORDER BY number DESC LIMIT 1 OFFSET :most)
"""


@dataclass(frozen=True)
class StoreInfo:
    """Robot and domain of all episodes of a store."""

    robot_digest: str
    domain: str


class RecordStore:
    """Appends episodes; the oldest ones are dropped if the store is full.

    One process at a time may append: see `ator_ros.files.exclusive_folder`. `stored` is the number
    of episodes that were ever stored.

    Parameters
    ----------
    folder : Path
        Created if it is missing.
    most : int
        How many episodes of each action set are kept.

    Raises
    ------
    FileError
        The folder is a store of another robot or domain, or damaged.
    OSError
        It cannot be written.
    """

    def __init__(self, folder: Path, info: StoreInfo, *, most: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._most = most
        with _refusing_damage(folder):
            self._database = sqlite3.connect(folder / STORE, check_same_thread=False)
            self._database.executescript(_TABLES)
            source = self._database.execute(_SOURCE).fetchone()
            if source is None:
                with self._database:
                    self._database.execute("INSERT INTO source VALUES (?, ?)", astuple(info))
            elif (got := StoreInfo(*source)) != info:
                raise FileError(
                    f"{folder / STORE}: expected {info}, got {got}: choose another folder"
                )
            (newest,) = self._database.execute("SELECT max(number) FROM episodes").fetchone()
        self.stored: int = newest or 0

    def append(self, action_set: str, episode: Episode) -> None:
        """Append an episode; it is written whole or, when OSError is raised, not at all."""
        (row, *_) = episode_frame(0, episode, episode.objects).to_dict("records")
        values = {"set": action_set, "row": json.dumps(row), "most": self._most}
        try:
            with self._database:
                self._database.execute(_APPEND, values)
                self._database.execute(_DROP_OLDEST, values)
            self.stored += 1
        except sqlite3.Error as error:
            raise OSError(errno.EIO, str(error)) from error

    def close(self) -> None:
        """Close the file."""
        self._database.close()


@contextmanager
def _refusing_damage(folder: Path) -> Iterator[None]:
    """Raise FileError instead of the errors of SQLite and of the JSON parser."""
    try:
        yield
    except (sqlite3.Error, json.JSONDecodeError) as error:
        raise FileError(f"{folder / STORE}: expected a store of records: {error}") from error


def _rows_of(folder: Path, query: str, *values: str) -> list[Any]:
    """Return the rows that a query of a store yields."""
    with _refusing_damage(folder), closing(sqlite3.connect(folder / STORE)) as database:
        return database.execute(query, values).fetchall()


def is_store(path: Path) -> bool:
    """Return whether `path` is a folder with a store."""
    return (path / STORE).is_file()


def action_sets_in(folder: Path) -> list[str]:
    """Return the action sets with episodes in a store."""
    rows = _rows_of(folder, "SELECT DISTINCT action_set FROM episodes ORDER BY action_set")
    return [name for (name,) in rows]


def read_store(folder: Path, action_set: str | None = None) -> Experience:
    """Read the episodes of an action set, by default the only one of the store, as experience.

    Raises FileError if `folder` has no store, and ExperienceError if the store has no episodes of
    the set.
    """
    names = action_sets_in(folder)
    if action_set is None and len(names) > 1:
        raise ExperienceError(f"{folder}: expected --action-set, one of {', '.join(names)}")
    name = action_set or next(iter(names), DEFAULT_SET)
    rows = read_records(folder, name)
    if rows.empty:
        raise ExperienceError(f"{folder}: expected episodes of the action set {name}, found none")
    source = StoreInfo(*_rows_of(folder, _SOURCE)[0])
    metadata = {**asdict(source), "action_set": name, "command": "learning"}
    return Experience(rows.drop(columns=NUMBER), metadata)


def read_records(folder: Path, action_set: str) -> pd.DataFrame:
    """Return the starts of the episodes of an action set, oldest first: columns of a table, and `NUMBER`."""
    query = "SELECT number - 1, row FROM episodes WHERE action_set = ? ORDER BY number"
    stored = _rows_of(folder, query, action_set)
    if not stored:
        return join([]).assign(**{NUMBER: np.empty(0, dtype=np.int64)})
    numbers, texts = zip(*stored, strict=True)
    with _refusing_damage(folder):
        rows = pd.DataFrame(map(json.loads, texts)).assign(episode=range(len(texts)))
    return checked_rows(folder / STORE, rows, action_set).assign(**{NUMBER: numbers})
