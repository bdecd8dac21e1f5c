"""Experience as one table: an example a row at 10 Hz, in Parquet with its metadata (paper, section 3)."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import MOST_GOAL_VARIABLES, direct_name
from ator_ros.bases.drive_parts import DriveParts, parts_of_drive
from ator_ros.experience.episode import Episode
from ator_ros.files import atomic_write, content_of, header, is_name
from ator_ros.geometry import FloatArray
from ator_ros.printable import ReadableError, printable, quoted
from ator_ros.schema import SchemaError
from ator_ros.world.messages import MOST_OBJECTS


class ExperienceError(ReadableError, ValueError):
    """Experience cannot be used; the message names the file, the field and the expected value."""

    longest = 600  # names topics of recordings and columns of tables beside what was expected


LARGEST = 1e9
"""Greatest number in a table: thirty years in s; in m it exceeds `world.messages.FARTHEST`."""
STATE_COLUMNS = ("t", "x", "y", "yaw", "v", "w", "vy")
"""Time and the robot's state, in the order of a sample: s since the start, m, m, rad, m/s, rad/s, m/s."""

_BEFORE = {
    "action": "name of the action",
    "episode": "number of the episode within its action",
    "t": "s since the start of the episode",
    "x": "m, axle",
    "y": "m, axle",
    "yaw": "rad",
    "v": "m/s, forward",
    "w": "rad/s, counter-clockwise",
    "vy": "m/s, to the left",
}
_GOAL = {
    "xg": "m, goal of the axle (hold 0) or of the hold (hold 1)",
    "yg": "m, goal of the axle (hold 0) or of the hold (hold 1)",
    "yawg": "rad, heading at the goal",
    "speedg": "m/s, forward speed at the goal",
}
_AFTER = {
    "hold": "1: (xg, yg) is the goal of the hold, the place in front where objects are held; 0: of the axle",
    "time_to_go": "s until the action ended",
    "duration": "s, of the whole episode",
    "success": "the action ended well, and the post-condition of its TOP holds",
    "reason": "how the episode ended",
    "first_turn": "s until the robot had driven 5 cm; NaN if unknown, as in drives below 10 cm",
    "last_turn": "s from when 5 cm of the drive were left until the action ended; NaN if unknown",
    "driven": "m, forward minus backward, by odometry; NaN if unknown",
    "position_error": "m, at the end",
    "heading_error": "rad, at the end; NaN where the heading does not matter",
}


def columns(objects: Iterable[str], goal_variables: Iterable[str] = ()) -> dict[str, str]:
    """Return name and meaning of each column of a table; SI units, world frame.

    `objects` are those whose places it has, `goal_variables` are declared by actions beyond pose
    and speed.
    """
    places = {name: f"m, NaN without {name.rpartition('_')[0]}" for name in object_columns(objects)}
    declared = {
        direct_name(name): f"goal variable {name} in its declared unit, NaN of an action without it"
        for name in goal_variables
    }
    return {**_BEFORE, **places, **_GOAL, **declared, **_AFTER}


def object_columns(objects: Iterable[str]) -> list[str]:
    """Return the names of the columns of objects: NAME_x and NAME_y of each, in m, NaN where unknown."""
    return [f"{name}_{axis}" for name in objects for axis in "xy"]


def objects_of_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the objects whose two columns are among `names`, in their order."""
    names = list(names)
    found = (name.removesuffix("_x") for name in names if name.endswith("_x") and name != "_x")
    return tuple(name for name in found if f"{name}_y" in names)


def goal_variables_of_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the declared goal variables whose columns are among `names`, in their order."""
    suffix = direct_name("")
    found = (
        name.removesuffix(suffix) for name in names if name.endswith(suffix) and name not in _GOAL
    )
    return tuple(name for name in found if name)


def columns_among(names: Iterable[str]) -> dict[str, str]:
    """Return `columns` for the objects and goal variables whose columns are among `names`."""
    names = list(names)
    return columns(objects_of_columns(names), goal_variables_of_columns(names))


# The table

KIND = "experience"
_KEY = b"ator_ros"
_TEXTS = ["action", "reason"]
_LEAST = {
    **dict.fromkeys(("x", "y", "yaw", "v", "w", "vy", "xg", "yg", "yawg"), -LARGEST),
    **dict.fromkeys(("episode", "t", "time_to_go", "duration", "speedg", "hold", "success"), 0.0),
}
"""Least number of each column that has no NaN."""
_GREATEST = {"hold": 1.0, "success": 1.0}
_TYPES = {"episode": np.int32, "hold": np.int8, "success": bool}
"""Columns of whole numbers and of true and false; all other numbers are floats."""


def checked_rows(source: Path | str, frame: pd.DataFrame, action_set: object) -> pd.DataFrame:
    """Check rows of experience, with columns of any types, and return their known columns with plain types.

    Parameters
    ----------
    source : Path or str
        File of the rows, for the message.
    action_set : object
        Name of the set of the actions.

    Raises
    ------
    ExperienceError
        There are no rows, a column is missing, or a column has a value of another type or range.
    """
    objects, declared = objects_of_columns(frame.columns), goal_variables_of_columns(frame.columns)
    wanted = columns(objects, declared)
    has_parts = {*DriveParts._fields} <= {*frame.columns}
    frame = frame if has_parts else frame.assign(**DriveParts()._asdict())
    frame = frame if "vy" in frame else frame.assign(vy=0.0)  # as in tables of version 0.1
    if missing := [name for name in wanted if name not in frame.columns]:
        raise ExperienceError(
            f"{source}: expected the columns {', '.join(wanted)}; missing: {', '.join(missing)}"
        )
    if frame.empty:
        raise ExperienceError(f"{source}: expected rows of experience, found none")
    names = {
        "action_set": [action_set],
        "action": frame["action"].unique(),
        "column": (*objects, *declared),
    }
    for field, name in ((field, name) for field, several in names.items() for name in several):
        if not is_name(name):
            expected = "expected a name of letters, digits and _"
            raise ExperienceError(f"{source}: {field}: {expected}, got {quoted(name)}")
    if len(objects) > MOST_OBJECTS or len(declared) > MOST_GOAL_VARIABLES:
        most = f"at most {MOST_OBJECTS} objects and {MOST_GOAL_VARIABLES} goal variables"
        raise ExperienceError(f"{source}: expected {most}, got {len(objects)} and {len(declared)}")
    checked = {
        name: frame[name].astype(object) if name in _TEXTS else _numbers(source, frame[name])
        for name in wanted
    }
    rows = pd.DataFrame(checked).astype(_TYPES)
    if not has_parts:  # as in tables of version 0.1
        parts = {
            key: parts_of_drive(
                drive["t"].to_numpy(), drive["v"].to_numpy(), drive["duration"].iloc[0]
            )
            for key, drive in rows.groupby(["action", "episode"])
        }
        drives = zip(rows["action"], rows["episode"], strict=True)
        rows[list(DriveParts._fields)] = [parts[drive] for drive in drives]
    return rows


def _numbers(source: Path | str, column: pd.Series) -> FloatArray:
    """Return the numbers of a column of any numeric type, checked."""
    name = str(column.name)
    low, high = (
        _LEAST.get(name, 0.0 if name.endswith("_error") else -LARGEST),
        _GREATEST.get(name, LARGEST),
    )
    kind = "whole numbers" if name in _TYPES else "numbers"
    expected = f"{source}: {name}: expected {kind} from {low:g} to {high:g}"
    if not pd.api.types.is_numeric_dtype(column):
        raise ExperienceError(f"{expected}, got the type {column.dtype}")
    values: FloatArray = column.to_numpy(dtype=float, na_value=np.nan)
    good = (values >= low) & (values <= high) | np.isnan(values) & (name not in _LEAST)
    if name in _TYPES:
        good &= values == np.round(values)
    if not good.all():
        row = int(np.argmin(good))
        raise ExperienceError(f"{expected}, got {values[row]:g} in row {row}")
    return values


@dataclass(frozen=True)
class Experience:
    """Examples and where they come from.

    Attributes
    ----------
    frame : pandas.DataFrame
        The columns of `columns`; the rows of each episode are together, in the order of time.
    metadata : dict
        Robot digest, domain, action set and command; those of `collect` have also the seed and the
        versions of the libraries.
    remarks : tuple of str
        Skipped or doubtful data in the source; not saved.
    """

    frame: pd.DataFrame
    metadata: dict[str, Any]
    remarks: tuple[str, ...] = ()

    def of(self, action: str) -> pd.DataFrame:
        """Return the rows of one action, if there are any."""
        return self.frame[self.frame["action"] == action].reset_index(drop=True)


def episode_frame(number: int, episode: Episode, objects: tuple[str, ...]) -> pd.DataFrame:
    """Return the rows of an episode, the one with this number within its action.

    `objects` are those whose places are kept, NaN in an episode without them.
    """
    frame = pd.DataFrame(
        episode.samples, columns=[*STATE_COLUMNS, *object_columns(episode.objects)]
    )
    goal = episode.situation.goal
    parts = episode.parts
    if parts is None:
        parts = parts_of_drive(frame["t"].to_numpy(), frame["v"].to_numpy(), episode.duration)
    others = {
        **dict.fromkeys(
            object_columns(name for name in objects if name not in episode.objects), np.nan
        ),
        "action": episode.situation.action,
        "episode": number,
        "xg": goal.pose.x,
        "yg": goal.pose.y,
        "yawg": goal.pose.yaw,
        "speedg": goal.speed,
        **{direct_name(name): value for name, value in goal.values.items()},
        "hold": int(goal.point is Point.HOLD),
        "time_to_go": episode.duration - frame["t"],
        "duration": episode.duration,
        "success": episode.success,
        "reason": episode.reason,
        **parts._asdict(),
        "position_error": episode.position_error,
        "heading_error": episode.heading_error,
    }
    return frame.assign(**others)[list(columns(objects, goal.values))]


def join(frames: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Join frames of episodes, of any objects, into one table with the column types of the file."""
    parts = list(frames)
    if not parts:
        return pd.DataFrame({name: pd.Series(dtype=float) for name in columns(())})
    joined = pd.concat(parts, ignore_index=True)
    return joined.reindex(columns=list(columns_among(joined.columns))).astype(_TYPES)


def count_episodes(rows: pd.DataFrame) -> int:
    """Return the number of episodes in a table."""
    return len(rows[["action", "episode"]].drop_duplicates())


def without_repeats(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table without the episodes that equal an earlier one."""
    if rows.empty:
        return rows
    codes, _ = pd.factorize(rows["action"])
    names = np.column_stack([codes, rows["episode"]])
    begins = np.flatnonzero(np.append(True, (names[1:] != names[:-1]).any(axis=1)))
    hashes = pd.util.hash_pandas_object(rows.drop(columns="episode"), index=False).to_numpy()
    known = set[bytes]()
    kept = np.full(len(rows), True)
    for begin, end in zip(begins, [*begins[1:], len(rows)], strict=True):
        content = hashes[begin:end].tobytes()
        kept[begin:end] = content not in known
        known.add(content)
    return rows if kept.all() else rows[kept].reset_index(drop=True)


def library_versions() -> dict[str, str]:
    """Return the versions of Python and of libraries on which experience and models depend."""
    versions = {"python": platform.python_version()}
    for name in ("numpy", "scikit-learn", "pandas", "pybullet"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def write_experience(path: Path | str, experience: Experience) -> None:
    """Write the table and its metadata to one Parquet file, whole or not at all."""
    import pyarrow as pa  # only the offline tools need it
    import pyarrow.parquet as pq

    table = pa.Table.from_pandas(experience.frame, preserve_index=False)
    metadata = {
        **header(KIND),
        "columns": columns_among(experience.frame.columns),
        **experience.metadata,
    }
    text = json.dumps(metadata, sort_keys=True).encode()
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), _KEY: text})
    with atomic_write(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")


def read_experience(path: Path | str) -> Experience:
    """Read a table that `write_experience` wrote.

    Raises
    ------
    ExperienceError
        The file is missing, damaged or not experience, or `checked_rows` raises it.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    expected = f"{path}: expected a Parquet file with experience"
    if not Path(path).is_file():  # opening a pipe would block
        raise ExperienceError(f"{expected}, got none")
    try:
        with pq.ParquetFile(path) as file:
            text = (file.schema_arrow.metadata or {}).get(_KEY) or b"null"
            table = file.read(columns=list(columns_among(file.schema_arrow.names)))
            frame = table.replace_schema_metadata(None).to_pandas()  # pandas' own may be damaged
    except (OSError, UnicodeError, pa.ArrowException) as error:
        raise ExperienceError(f"{expected}: {printable(error, 200)}") from error
    try:
        metadata = content_of(json.loads(text), KIND)
    except SchemaError as error:
        raise ExperienceError(f"{path}: metadata.{error}") from error
    except (ValueError, RecursionError) as error:
        raise ExperienceError(f"{path}: metadata: expected JSON: {error}") from error
    return Experience(
        checked_rows(path, frame, metadata.get("action_set") or DEFAULT_SET), metadata
    )
