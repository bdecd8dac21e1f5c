"""Experience as one table: an example per row at 10 Hz, in Parquet with its metadata (paper, section 3)."""

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
from ator_ros.experience.columns import (
    LARGEST,
    STATE_COLUMNS,
    ExperienceError,
    columns,
    goal_variables_of_columns,
    object_columns,
    objects_of_columns,
)
from ator_ros.experience.episode import Episode
from ator_ros.files import atomic_write, content_of, header, is_name, limited_memory
from ator_ros.geometry import FloatArray
from ator_ros.printable import printable, quoted
from ator_ros.schema import SchemaError, structured
from ator_ros.world.messages import MOST_OBJECTS

KIND = "experience"
_KEY = b"ator_ros"
_TEXTS = ["action", "reason"]
_MOST_ROWS = 5_000_000  # 30 times those of a thousand episodes of each action
_MOST_BYTES = 4_000_000_000  # of memory
_BOUNDS: dict[str, tuple[float, float]] = {
    "episode": (0.0, 1e7),
    **dict.fromkeys(("t", "time_to_go", "duration", "speedg"), (0.0, LARGEST)),
    **dict.fromkeys(("x", "y", "yaw", "v", "w", "xg", "yg", "yawg"), (-LARGEST, LARGEST)),
    **dict.fromkeys(("hold", "success"), (0.0, 1.0)),
    **dict.fromkeys(("position_error", "heading_error"), (0.0, LARGEST)),
}
"""Least and greatest number of each column; those of objects and declared goal variables are as for x."""
_TYPES = {"episode": np.int32, "hold": np.int8, "success": bool}
"""Columns of whole numbers and of true and false; all other numbers are floats."""
_MAY_BE_NAN = ("position_error", "heading_error")


def checked_rows(source: Path | str, frame: pd.DataFrame, action_set: object) -> pd.DataFrame:
    """Check rows of experience, and return their known columns with plain types.

    Parameters
    ----------
    source : Path or str
        File of the rows, for the message.
    frame : pandas.DataFrame
        With the columns of `columns.columns`, of any types.
    action_set : object
        Name of the set that the actions are of.

    Raises
    ------
    ExperienceError
        There are no rows, a column is missing, or a value is not what its column holds.
    """
    objects, declared = objects_of_columns(frame.columns), goal_variables_of_columns(frame.columns)
    wanted = columns(objects, declared)
    if missing := [name for name in wanted if name not in frame.columns]:
        raise ExperienceError(
            f"{source}: expected the columns {', '.join(wanted)}; missing: {', '.join(missing)}"
        )
    if frame.empty:
        raise ExperienceError(f"{source}: expected rows of experience, found none")
    names = [("action_set", action_set), *(("action", name) for name in frame["action"].unique())]
    names += [("column", name) for name in (*objects, *declared)]
    for field, name in names:
        if not is_name(name):
            raise ExperienceError(
                f"{source}: {field}: expected a name of letters, digits and _, got {quoted(name)}"
            )
    if len(objects) > MOST_OBJECTS or len(declared) > MOST_GOAL_VARIABLES:
        most = f"at most {MOST_OBJECTS} objects and {MOST_GOAL_VARIABLES} goal variables"
        raise ExperienceError(f"{source}: expected {most}, got {len(objects)} and {len(declared)}")
    texts = {name: frame[name].astype(object) for name in _TEXTS}
    checked = {name: texts[name] if name in texts else _numbers(source, frame[name]) for name in wanted}
    return pd.DataFrame(checked).astype(_TYPES)


def _numbers(source: Path | str, column: pd.Series) -> FloatArray:
    """Return the numbers of a column, which may be of any type that holds numbers."""
    name = str(column.name)
    low, high = _BOUNDS.get(name, _BOUNDS["x"])
    is_whole, may_be_nan = name in _TYPES, name in _MAY_BE_NAN or name not in _BOUNDS
    kind = "whole numbers" if is_whole else "numbers"
    where = f"{source}: {name}: expected {kind} from {low:g} to {high:g}{', or NaN' if may_be_nan else ''}"
    is_truth = pd.api.types.is_bool_dtype(column)
    if not pd.api.types.is_numeric_dtype(column) or (is_truth and high != 1.0):
        raise ExperienceError(f"{where}, got the type {column.dtype}")
    values: FloatArray = column.to_numpy(dtype=float, na_value=np.nan)
    good = (values >= low) & (values <= high)
    with np.errstate(invalid="ignore"):
        good &= (values % 1.0 == 0.0) | (not is_whole)
    wrong = np.flatnonzero(~(good | (np.isnan(values) & may_be_nan)))
    if wrong.size:
        raise ExperienceError(f"{where}, got {values[wrong[0]]:g} in row {wrong[0]}")
    return values


@dataclass(frozen=True)
class Experience:
    """Examples and where they come from.

    Attributes
    ----------
    frame : pandas.DataFrame
        The columns of `columns`; the rows of an episode of an action together, in the order of time.
    metadata : dict
        How it was made: seed, robot digest, domain, action set, command, versions.
    remarks : tuple of str
        What was skipped or doubtful when it was read; not saved.
    """

    frame: pd.DataFrame
    metadata: dict[str, Any]
    remarks: tuple[str, ...] = ()

    @property
    def seed(self) -> int:
        """The seed that it was collected with; 0 for a recording, which has none."""
        seed = self.metadata.get("seed")
        return seed if isinstance(seed, int) else 0

    @property
    def objects(self) -> tuple[str, ...]:
        """The objects whose places it holds."""
        return objects_of_columns(self.frame.columns)

    @property
    def goal_variables(self) -> tuple[str, ...]:
        """The goal variables beyond pose and speed whose values it holds."""
        return goal_variables_of_columns(self.frame.columns)

    def of(self, action: str) -> pd.DataFrame:
        """Return the rows of one action; none where there are no episodes of it."""
        return self.frame[self.frame["action"] == action].reset_index(drop=True)


def episode_frame(number: int, episode: Episode, objects: tuple[str, ...]) -> pd.DataFrame:
    """Return the rows of one episode.

    Parameters
    ----------
    number : int
        Number of the episode within its action.
    episode : Episode
        What was observed.
    objects : tuple of str
        The objects whose places are kept, NaN in an episode without them.
    """
    frame = pd.DataFrame(episode.samples, columns=[*STATE_COLUMNS, *object_columns(episode.objects)])
    constants = {
        **dict.fromkeys(object_columns(name for name in objects if name not in episode.objects), np.nan),
        **_constants(episode),
        "episode": number,
        "time_to_go": episode.duration - frame["t"],
    }
    return frame.assign(**constants)[list(columns(objects, episode.situation.goal.values))]


def start_row(episode: Episode) -> dict[str, Any]:
    """Return the first row of an episode by column, without its number."""
    start = zip((*STATE_COLUMNS, *object_columns(episode.objects)), episode.samples[0].tolist(), strict=True)
    return {**dict(start), **_constants(episode), "time_to_go": episode.duration}


def _constants(episode: Episode) -> dict[str, Any]:
    """Return the columns that are the same in all rows of an episode."""
    goal = episode.situation.goal
    return {
        "action": episode.situation.action,
        "xg": goal.pose.x,
        "yg": goal.pose.y,
        "yawg": goal.pose.yaw,
        "speedg": goal.speed,
        **{direct_name(name): value for name, value in goal.values.items()},
        "hold": int(goal.point is Point.HOLD),
        "duration": episode.duration,
        "success": episode.success,
        "reason": episode.reason,
        "position_error": episode.position_error,
        "heading_error": episode.heading_error,
    }


def join(frames: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Join frames of episodes, of whatever objects, into one table with the column types of the file."""
    parts = list(frames)
    if not parts:
        return pd.DataFrame({name: pd.Series(dtype=float) for name in columns(())})
    joined = pd.concat(parts, ignore_index=True)
    there = joined.columns
    ordered = joined[list(columns(objects_of_columns(there), goal_variables_of_columns(there)))]
    return ordered.astype(_TYPES)


def library_versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that experience and models depend on."""
    versions = {"python": platform.python_version()}
    for name in ("numpy", "scikit-learn", "pandas", "pybullet"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


def write_experience(path: Path | str, experience: Experience) -> None:
    """Write the table and its metadata to one Parquet file, whole or not at all.

    Raises
    ------
    ExperienceError
        pyarrow is not installed.
    """
    arrow, parquet = require_pyarrow()
    table = arrow.Table.from_pandas(experience.frame, preserve_index=False)
    metadata = {
        **header(KIND),
        "columns": columns(experience.objects, experience.goal_variables),
        "objects": experience.objects,
        **({"goal_variables": experience.goal_variables} if experience.goal_variables else {}),
        **experience.metadata,
    }
    text = json.dumps(metadata, sort_keys=True).encode()
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), _KEY: text})
    with atomic_write(path) as temporary:
        parquet.write_table(table, temporary, compression="zstd")


def read_experience(path: Path | str) -> Experience:
    """Read a table that `write_experience` wrote.

    Raises
    ------
    ExperienceError
        The file is missing, damaged, not experience, lacks a column, or a value
        in it is not what its column holds.
    """
    arrow, parquet = require_pyarrow()
    expected = f"{path}: expected a Parquet file with experience"
    if not Path(path).is_file():  # opening a pipe would block
        raise ExperienceError(f"{expected}, got none")
    try:
        with limited_memory(_MOST_BYTES), parquet.ParquetFile(path) as file:
            metadata, declared = _metadata(path, (file.schema_arrow.metadata or {}).get(_KEY))
            if file.metadata.num_rows > _MOST_ROWS:
                raise ExperienceError(
                    f"{path}: expected at most {_MOST_ROWS} rows, got {file.metadata.num_rows}"
                )
            table = file.read(columns=list(columns(declared.objects, declared.goal_variables)))
            frame = table.replace_schema_metadata(None).to_pandas()  # pandas' own may be damaged
    except (OSError, MemoryError, UnicodeError, arrow.ArrowException) as error:
        why = "it needs too much memory" if isinstance(error, MemoryError) else printable(error, 200)
        raise ExperienceError(f"{expected}: {why}") from error
    action_set = DEFAULT_SET if declared.action_set is None else declared.action_set
    return Experience(checked_rows(path, frame, action_set), metadata)


@dataclass(frozen=True)
class _Metadata:
    """The metadata that are used; a recording has no seed, and perhaps no action set."""

    objects: tuple[str, ...]
    goal_variables: tuple[str, ...] = ()
    seed: int | None = None
    robot_digest: str | None = None
    domain: str | None = None
    action_set: str | None = None
    command: str | None = None
    records_left_out: int = 0


def _metadata(path: Path | str, text: bytes | None) -> tuple[dict[str, Any], _Metadata]:
    """Return the metadata as they are, which experience carries along, and as their schema."""
    try:
        metadata = content_of(json.loads(text or b"null"), KIND)
        return metadata, structured(metadata, _Metadata)
    except SchemaError as error:
        raise ExperienceError(f"{path}: metadata.{error}") from error
    except (ValueError, RecursionError) as error:
        raise ExperienceError(f"{path}: metadata: expected JSON: {error}") from error


def require_pyarrow() -> tuple[Any, Any]:
    """Return the modules pyarrow and pyarrow.parquet.

    Raises
    ------
    ExperienceError
        pyarrow, which only the offline tools need, is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise ExperienceError("experience tables need the package pyarrow: pip install pyarrow") from error
    return pa, pq
