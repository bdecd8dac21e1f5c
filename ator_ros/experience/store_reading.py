"""Reading a store of records (`ator_ros.experience.store`), and converting its closed parts."""

from __future__ import annotations

import json
import os
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
from ator_ros.experience.store import PART, STORE, StoreInfo, parts_of, read_info
from ator_ros.experience.table import (
    Experience,
    checked_rows,
    join,
    library_versions,
    read_experience,
    write_experience,
)
from ator_ros.files import is_name

NUMBER = "number"
"""Column of a store's episodes: their numbers, which rise with time and are never used twice."""
_MOST_COLUMNS = len(columns(())) + 2 * MOST_OBJECTS + MOST_GOAL_VARIABLES


@dataclass(frozen=True)
class StoredRecords:
    """What a store holds of one action set.

    Attributes
    ----------
    rows : pandas.DataFrame
        The starts of the episodes, oldest first, with the columns of a table and `NUMBER`.
    damaged : int
        Lines and parts that could not be read, and were left out.
    """

    rows: pd.DataFrame
    damaged: int


def is_store(path: Path) -> bool:
    """Return whether `path` is the folder of a store."""
    return (path / STORE).is_file()


def action_sets_in(folder: Path) -> list[str]:
    """Return the action sets of which a store holds episodes."""
    return sorted(place.name for place in folder.iterdir() if is_name(place.name) and parts_of(place))


def read_store(folder: Path, action_set: str | None = None) -> Experience:
    """Read the episodes of an action set as experience.

    Parameters
    ----------
    folder : Path
        Of the store.
    action_set : str, optional
        Name of the set; it may be left out where the store holds one only.

    Raises
    ------
    ExperienceError
        `folder` is no store, or holds no episodes of the set.
    """
    info, there = read_info(folder), action_sets_in(folder)
    if action_set is None and len(there) > 1:
        raise ExperienceError(f"{folder}: expected --action-set, one of {', '.join(there)}")
    name = action_set or (there[0] if there else DEFAULT_SET)
    stored = read_records(folder, name)
    if stored.rows.empty:
        raise ExperienceError(f"{folder}: expected episodes of the action set {name}, found none")
    rows = stored.rows.drop(columns=NUMBER)
    return Experience(rows, _metadata(info, name) | {"records_left_out": stored.damaged})


def read_records(folder: Path, action_set: str) -> StoredRecords:
    """Read all episodes of an action set; what is damaged is left out, and counted."""
    frames, damaged = [], 0
    for number, file in parts_of(folder / action_set).items():
        try:
            rows, lost = _part(file, action_set)
        except (ExperienceError, OSError):  # OSError: dropped meanwhile
            damaged += 1
            continue
        frames.append(rows.assign(**{NUMBER: number * PART + rows["episode"].to_numpy(dtype=np.int64)}))
        damaged += lost
    numbers = [frame[NUMBER].to_numpy() for frame in frames]
    rows = join(frame.drop(columns=NUMBER) for frame in frames)
    rows["episode"] = np.arange(len(rows), dtype=np.int32)
    rows[NUMBER] = np.concatenate(numbers) if numbers else np.empty(0, dtype=np.int64)
    return StoredRecords(rows, damaged)


def convert_closed(folder: Path) -> None:
    """Turn every part of a store but the last of each action set into Parquet.

    Two processes may do so at once: both write the same. A part that is dropped before it is read is left
    alone; dropped later, it is there again until the store drops it once more.
    """
    info = read_info(folder)
    for action_set in action_sets_in(folder):
        for file in list(parts_of(folder / action_set).values())[:-1]:
            lines = file.with_suffix(".jsonl")
            if file.suffix == ".jsonl":
                try:
                    rows, lost = _part(file, action_set)
                except FileNotFoundError:
                    continue
                metadata = _metadata(info, action_set) | {"records_left_out": lost}
                write_experience(file.with_suffix(".parquet"), Experience(rows, metadata))
                _sync(file.with_suffix(".parquet"))
            lines.unlink(missing_ok=True)


def _sync(file: Path) -> None:
    for path in (file, file.parent):
        handle = os.open(path, os.O_RDONLY)
        os.fsync(handle)
        os.close(handle)


def _metadata(info: StoreInfo, action_set: str) -> dict[str, object]:
    return {
        "seed": None,
        "robot_digest": info.robot_digest,
        "domain": info.domain,
        "action_set": action_set,
        "command": "learning",
        "versions": library_versions(),
    }


def _part(file: Path, action_set: str) -> tuple[pd.DataFrame, int]:
    """Return the rows of a part and how many lines of it are damaged; `episode` is the line."""
    if file.suffix == ".parquet":
        experience = read_experience(file)
        return experience.frame, experience.metadata.get("records_left_out", 0)
    lines = file.read_bytes().split(b"\n")[:-1]
    rows = [row for number, line in enumerate(lines) if (row := _row(line, number)) is not None]
    try:
        frame = _checked(file, rows, action_set)
    except ExperienceError:  # a line that is no episode shall not cost the others
        rows = [row for row in rows if _fits(file, row, action_set)]
        frame = _checked(file, rows, action_set)
    return frame, len(lines) - len(rows)


def _checked(file: Path, rows: list[dict[str, object]], action_set: str) -> pd.DataFrame:
    """Return lines as checked rows of experience; raise ExperienceError where one of them is no episode."""
    if not rows:
        return join([])
    objects = tuple(dict.fromkeys(name for row in rows for name in objects_of_columns(row)))
    declared = tuple(dict.fromkeys(name for row in rows for name in goal_variables_of_columns(row)))
    wanted = set(columns(()))
    for names, most, what in (
        (objects, MOST_OBJECTS, "objects"),
        (declared, MOST_GOAL_VARIABLES, "variables"),
    ):
        if len(names) > most or not all(map(is_name, names)):
            raise ExperienceError(f"{file}: expected at most {most} {what} with names")
    if not all(wanted <= set(row) for row in rows):
        raise ExperienceError(f"{file}: expected the columns {', '.join(wanted)} in every line")
    frame = pd.DataFrame(rows, columns=list(columns(objects, declared)))
    numbers = {*object_columns(objects), *map(direct_name, declared), "position_error", "heading_error"}
    try:
        frame = frame.astype(dict.fromkeys(numbers, float))  # all of them may be null
    except (ValueError, TypeError, OverflowError) as error:
        raise ExperienceError(f"{file}: expected numbers: {error}") from error
    return checked_rows(file, frame, action_set)


def _row(line: bytes, number: int) -> dict[str, object] | None:
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(row, dict) or len(row) > _MOST_COLUMNS:
        return None
    return {**row, "episode": number}


def _fits(file: Path, row: dict[str, object], action_set: str) -> bool:
    """Return whether a line is an episode by itself."""
    try:
        _checked(file, [row], action_set)
    except ExperienceError:
        return False
    return True
