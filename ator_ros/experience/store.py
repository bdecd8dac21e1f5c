"""A bounded store of episodes, FOLDER/records.db: a node appends while others read.

It is an SQLite database: a process that is killed loses no appended episode. Its rollback journal
also works on network shares, and a store on a read-only medium can be read.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import sqlite3
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.databases import (
    code_of,
    connected,
    limit,
    require_table,
    signals_raised,
    text_of,
)
from ator_ros.experience.table import Episode, Experience, ExperienceError, checked_rows, join
from ator_ros.files import DamagedFileError, FileError, identity_of
from ator_ros.printable import printable, quoted

STORE = "records.db"
NUMBER = "number"
"""Column of the numbers of episodes, which increase with time and are never used twice."""
_TABLES = """
PRAGMA journal_mode = DELETE;
CREATE TABLE IF NOT EXISTS source (robot_digest TEXT, domain TEXT);
CREATE TABLE IF NOT EXISTS episodes
(number INTEGER PRIMARY KEY AUTOINCREMENT, action_set TEXT, row TEXT);
CREATE INDEX IF NOT EXISTS by_set ON episodes (action_set, number);
"""
_SOURCE = "SELECT 0, robot_digest, domain FROM source LIMIT 1"
_FIRST = "INSERT INTO sqlite_sequence VALUES ('episodes', ?)"
_STORED = "SELECT seq FROM sqlite_sequence WHERE name = 'episodes'"
_APPEND = "INSERT INTO episodes (action_set, row) VALUES (:set, :row)"
_DROP_OLDEST = """
DELETE FROM episodes WHERE action_set = :set AND number <=
(SELECT number FROM episodes WHERE action_set = :set ORDER BY number DESC LIMIT 1 OFFSET :most)
"""
# other errors, such as of a full disk, do not depend on the content of the file
_DAMAGE = (
    sqlite3.SQLITE_ERROR,
    sqlite3.SQLITE_CORRUPT,
    sqlite3.SQLITE_NOTADB,
    sqlite3.SQLITE_TOOBIG,
)
_LONGEST = 1 << 20  # bytes of a record; those of soccer have 2 kB
_PROGRAMS = "SELECT type, name FROM sqlite_master WHERE type IN ('trigger', 'view')"


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
    first : int
        The number of the first episode of a new store.

    Raises
    ------
    FileError
        The folder is a store of another robot or domain; DamagedFileError if it is damaged.
    OSError
        It cannot be read or written.
    """

    def __init__(self, folder: Path, info: StoreInfo, *, most: int, first: int = 0) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._file = folder / STORE
        self._most = most
        self._opened: tuple[int, int] | None = None  # identity of the open file
        with _errors_of(self._file):
            self._database = sqlite3.connect(self._file, check_same_thread=False)
        limit(self._database, longest=_LONGEST)
        try:
            with _errors_of(self._file):
                self._prepare(info, first)
        except (FileError, OSError):
            self.close()
            raise
        self._opened = identity_of(self._file)

    def _prepare(self, info: StoreInfo, first: int) -> None:
        """Create the tables of a new store; check and count those of an old one."""
        database = self._database
        for kind, name in database.execute(_PROGRAMS):
            program = f"the {kind} {printable(name)}"
            raise DamagedFileError(f"{self._file}: expected a store of records, got {program}")
        database.executescript(_TABLES)
        _require_tables(database)
        (report,) = database.execute("PRAGMA integrity_check(1)").fetchone()
        if report != "ok":
            raise DamagedFileError(
                f"{self._file}: expected a store of records: {printable(report)}"
            )
        source = database.execute(_SOURCE).fetchone()
        if source is None:
            with database:
                database.execute("INSERT INTO source VALUES (?, ?)", astuple(info))
                database.execute(_FIRST, [first])
        elif (got := StoreInfo(*source[1:])) != info:
            raise FileError(f"{self._file}: expected {info}, got {got}: choose another folder")
        (stored,) = database.execute(_STORED).fetchone() or (0,)
        if not isinstance(stored, int):
            raise DamagedFileError(
                f"{self._file}: expected the number of records, got {quoted(stored)}"
            )
        self.stored = stored

    def is_in_place(self) -> bool:
        """Return whether the file that is open is the one in the folder.

        Raises OSError if the folder cannot be read. SQLite writes to a deleted or renamed file
        without an error.
        """
        try:
            return self._opened is not None and self._opened == identity_of(self._file)
        except FileNotFoundError:
            return False

    def append(self, action_set: str, *episodes: Episode) -> None:
        """Append episodes in one transaction: when OSError is raised, none of them is written.

        Raises DamagedFileError if the file is damaged. The store is closed by both errors.
        """
        rows = [{"set": action_set, "row": _row_of(episode)} for episode in episodes]
        try:
            with _errors_of(self._file), self._database:
                self._database.executemany(_APPEND, rows)
                self._database.execute(_DROP_OLDEST, {"set": action_set, "most": self._most})
        except (FileError, OSError):
            self.close()
            raise
        self.stored += len(rows)

    def close(self) -> None:
        """Close the file."""
        self._opened = None
        with suppress(sqlite3.Error):
            self._database.close()


def _row_of(episode: Episode) -> str:
    (row, *_) = episode.rows(0, episode.situation.objects).to_dict("records")
    return json.dumps(row)


@contextmanager
def _errors_of(file: Path) -> Iterator[None]:
    """Raise DamagedFileError or OSError instead of the errors of SQLite."""
    try:
        with signals_raised():
            yield
    except FileError:
        raise
    except (sqlite3.Error, ValueError) as error:
        code = code_of(error)
        if code in _DAMAGE:
            shown = printable(error, 120)
            raise DamagedFileError(f"{file}: expected a store of records: {shown}") from error
        full = code == sqlite3.SQLITE_FULL
        raise OSError(errno.ENOSPC if full else errno.EIO, str(error), str(file)) from error


_Row = tuple[Any, ...]


def _read(folder: Path, query: str, *values: str) -> list[_Row]:
    """Return the rows of a query, whose first values are numbers that increase.

    Raises FileError.
    """
    file = folder / STORE
    try:
        if not is_store(folder):
            raise FileError(f"{file}: expected a store of records, there is none")
        with _errors_of(file):
            return _queried(file, query, values)
    except OSError as error:
        raise FileError(f"{file}: expected a store of records: {error.strerror}") from error


def _queried(file: Path, query: str, values: Sequence[str]) -> list[_Row]:
    """Return the rows of a query, also on a read-only medium."""
    try:
        return _queried_as("ro", file, query, values)
    except sqlite3.OperationalError as error:
        if code_of(error) == sqlite3.SQLITE_INTERRUPT:
            raise
        # SQLite has to write: a process was killed while it wrote, or the file is of version 0.1
        if os.access(file.parent, os.W_OK):
            return _queried_as("rw", file, query, values)
    with tempfile.TemporaryDirectory() as writable:
        for part in file.parent.glob(f"{STORE}*"):
            shutil.copyfile(part, Path(writable, part.name))
        return _queried_as("rw", Path(writable, STORE), query, values)


def _queried_as(mode: str, file: Path, query: str, values: Sequence[str]) -> list[_Row]:
    with closing(connected(file, f"mode={mode}", longest=_LONGEST)) as database:
        database.text_factory = text_of
        _require_tables(database)
        return list(_in_order(database.execute(query, values)))


def _require_tables(database: sqlite3.Connection) -> None:
    """Raise ValueError if a table of a store is missing, or is no stored table."""
    require_table(database, "source", "robot_digest", "domain")
    require_table(database, "episodes", "number", "action_set", "row")


def is_store(path: Path) -> bool:
    """Return whether `path` is a folder with a store."""
    return (path / STORE).is_file()


def action_sets_in(folder: Path) -> list[str]:
    """Return the action sets with episodes in a store; raises FileError."""
    rows = _read(folder, "SELECT number, action_set FROM episodes NOT INDEXED")
    return sorted({str(name) for _, name in rows})


def _in_order(rows: Iterable[_Row]) -> Iterator[_Row]:
    """Yield rows; raise ValueError unless their numbers increase: damage can make them endless."""
    last = None
    for row in rows:
        number = row[0]
        if not isinstance(number, int) or (last is not None and number <= last):
            raise ValueError("rows are not in order")
        last = number
        yield row


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
    sources = _read(folder, _SOURCE)
    if not sources:
        raise FileError(f"{folder / STORE}: expected a robot and a domain, got none")
    metadata = {**asdict(StoreInfo(*sources[0][1:])), "action_set": name, "command": "learning"}
    return Experience(rows.drop(columns=NUMBER), metadata)


def read_records(folder: Path, action_set: str) -> pd.DataFrame:
    """Return the starts of the episodes of an action set, oldest first, with `NUMBER`.

    Damaged rows are left out with a warning. Raises FileError if `folder` has no store.
    """
    query = "SELECT number, row FROM episodes NOT INDEXED WHERE action_set = ?"
    stored = [(number - 1, _parsed(text)) for number, text in _read(folder, query, action_set)]
    usable = _usable(stored, action_set)
    if len(usable) < len(stored):
        text = f"{len(stored) - len(usable)} of {len(stored)} records are damaged and left out"
        warnings.warn(f"{folder / STORE}: {text}", stacklevel=2)
    if not usable:
        return join([]).assign(**{NUMBER: np.empty(0, dtype=np.int64)})
    numbers = [number for number, _ in usable]
    return _checked(usable, action_set).assign(**{NUMBER: numbers})


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except (RecursionError, TypeError, ValueError):
        return None


def _checked(rows: Sequence[_Row], action_set: str) -> pd.DataFrame:
    frame = pd.DataFrame([content for _, content in rows]).assign(episode=range(len(rows)))
    return checked_rows(STORE, frame, action_set)


def _usable(rows: list[_Row], action_set: str) -> list[_Row]:
    """Return the rows that are valid; halves are checked until the damaged rows are found."""
    rows = [row for row in rows if isinstance(row[1], dict)]
    try:
        if rows:
            _checked(rows, action_set)
        return rows
    except (ExperienceError, ArithmeticError, AttributeError, TypeError, ValueError):
        if len(rows) == 1:
            return []
        middle = len(rows) // 2
        return [*_usable(rows[:middle], action_set), *_usable(rows[middle:], action_set)]
