"""Files of SQLite from others: only tables are read, in bounded memory; signals end it."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ator_ros.printable import printable

_STEPS = 20_000  # instructions of SQLite, about a millisecond, between two looks for signals


def connected(file: Path, options: str, *, longest: int) -> sqlite3.Connection:
    """Return a connection to a database with the options of its address, such as "mode=ro".

    A text or blob of more than `longest` bytes is an error.
    """
    database = sqlite3.connect(f"{file.absolute().as_uri()}?{options}", uri=True)
    limit(database, longest=longest)
    return database


def limit(database: sqlite3.Connection, *, longest: int) -> None:
    """Let signals interrupt queries; texts of more than `longest` bytes are errors."""
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, longest)
    # A pending signal makes the call of the handler fail, which interrupts the query.
    database.set_progress_handler(lambda: 0, _STEPS)


def text_of(data: bytes) -> str:
    """Return a stored text, of which any bytes may be damaged."""
    return data.decode("utf-8", errors="replace")


def require_table(database: sqlite3.Connection, table: str, *names: str) -> None:
    """Raise ValueError unless a table has these columns, and stores them.

    Views, virtual tables and computed columns are refused: they are programs, which need not end.
    """
    query = "SELECT type, substr(sql, 1, 13) FROM sqlite_master WHERE name = ? LIMIT 9"
    found = database.execute(query, (table,)).fetchall()
    if [(kind, str(sql).upper()) for kind, sql in found] != [("table", "CREATE TABLE ")]:
        got = ", ".join(printable(kind) for kind, _ in found) or "none"
        raise ValueError(f"expected the table {table}, got {got}")
    query = "SELECT name, hidden FROM pragma_table_xinfo(?)"
    columns = database.execute(query, (table,)).fetchall()
    if missing := [name for name in names if (name, 0) not in columns]:
        raise ValueError(f"{table}: expected the column {missing[0]}")


@contextmanager
def signals_raised() -> Iterator[None]:
    """Raise KeyboardInterrupt if a signal interrupted a query, instead of the error of SQLite."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if code_of(error) == sqlite3.SQLITE_INTERRUPT:
            raise KeyboardInterrupt from error
        raise


def code_of(error: Exception) -> int:
    """Return the primary code of an error of SQLite; Python's own errors have none."""
    return getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
