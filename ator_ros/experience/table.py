"""Experience as one table: an example per row at 10 Hz, in Parquet with its metadata (paper, section 3)."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import GOAL_VARIABLES, MOST_GOAL_VARIABLES, direct_name
from ator_ros.experience.columns import (
    LARGEST,
    MOST_OBJECTS,
    STATE_COLUMNS,
    ExperienceError,
    columns,
    goal_variables_of_columns,
    object_columns,
    objects_of_columns,
)
from ator_ros.experience.episode import Episode, sample_of
from ator_ros.files import atomic_write, content_of, header, is_name, limited_memory
from ator_ros.geometry import FloatArray
from ator_ros.printable import printable, quoted
from ator_ros.schema import AtMost, Name, SchemaError, require, structured
from ator_ros.world.state import World

_NAME = "a name of letters, digits and _"


class _Rule(NamedTuple):
    """The allowed numbers of a column; `whole`: without a fraction."""

    expected: str
    low: float
    high: float = LARGEST
    whole: bool = False
    unknown: bool = False  # may be NaN


_PLACE = _Rule("finite numbers up to 1e9", -LARGEST)
_NUMBER_OR_NAN = _Rule("finite numbers up to 1e9, or NaN", -LARGEST, unknown=True)
_TIME = _Rule("times in s from 0", 0.0)
_ERROR = _Rule("numbers from 0, or NaN", 0.0, unknown=True)
_RULES = {
    "episode": _Rule("whole numbers from 0 to 1e7", 0.0, 1e7, whole=True),
    **dict.fromkeys(("t", "time_to_go", "duration"), _TIME),
    **dict.fromkeys(("x", "y", "yaw", "v", "w", "xg", "yg", "yawg"), _PLACE),
    "speedg": _Rule("speeds in m/s from 0", 0.0),
    "hold": _Rule("0 or 1", 0.0, 1.0, whole=True),
    "success": _Rule("true or false", 0.0, 1.0, whole=True),
    **dict.fromkeys(("position_error", "heading_error"), _ERROR),
}
_TRUTHS = ("hold", "success")
"""Columns that may be of a type for true and false."""


def checked_rows(source: Path | str, frame: pd.DataFrame, action_set: object) -> pd.DataFrame:
    """Check rows of experience, and return them with plain types.

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
        There are no rows, or a value is not what its column holds.
    """
    if not is_name(action_set):
        raise ExperienceError(f"{source}: action_set: expected {_NAME}, got {quoted(action_set)}")
    if frame.empty:
        raise ExperienceError(f"{source}: expected rows of experience, found none")
    names = frame["action"].astype(object)
    for name in names.unique():
        if not is_name(name):
            raise ExperienceError(f"{source}: action: expected {_NAME}, got {quoted(name)}")
    objects = dict.fromkeys(object_columns(objects_of_columns(frame.columns)), _NUMBER_OR_NAN)
    declared = dict.fromkeys(map(direct_name, goal_variables_of_columns(frame.columns)), _NUMBER_OR_NAN)
    rules = {**_RULES, **objects, **declared}
    checked: dict[str, object] = {name: _numbers(source, frame[name], rule) for name, rule in rules.items()}
    checked |= {"action": names, "reason": frame["reason"].astype(object)}
    plain = {"episode": np.int32, "hold": np.int8, "success": bool}
    return pd.DataFrame({name: checked[name] for name in frame.columns}).astype(plain)


def _numbers(source: Path | str, column: pd.Series, rule: _Rule) -> FloatArray:
    """Return the numbers of a column, which may be of any type that holds numbers."""
    where = f"{source}: {column.name}: expected {rule.expected}"
    truths = pd.api.types.is_bool_dtype(column)
    if not pd.api.types.is_numeric_dtype(column) or (truths and column.name not in _TRUTHS):
        raise ExperienceError(f"{where}, got the type {column.dtype}")
    try:
        values: FloatArray = column.to_numpy(dtype=float, na_value=np.nan)
    except (TypeError, ValueError) as error:  # complex numbers, say
        raise ExperienceError(f"{where}, got the type {column.dtype}") from error
    with np.errstate(invalid="ignore"):
        good = (values >= rule.low) & (values <= rule.high)
        good &= (values % 1.0 == 0.0) | (not rule.whole)
    wrong = np.flatnonzero(~(good | (np.isnan(values) & rule.unknown)))
    if wrong.size:
        raise ExperienceError(f"{where}, got {values[wrong[0]]:g} in row {wrong[0]}")
    return values


KIND = "experience"
_KEY = b"ator_ros"
_TEXTS = ["action", "reason"]
_MOST_ROWS = 5_000_000  # 30 times those of a thousand episodes of each action
_MOST_BYTES = 4_000_000_000  # of memory


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
        """Return the rows of one action.

        Raises
        ------
        ExperienceError
            There are none; the message lists the actions there are.
        """
        rows = self.frame[self.frame["action"] == action]
        if rows.empty:
            there = ", ".join(sorted(set(self.frame["action"]))) or "none"
            raise ExperienceError(
                f"experience: expected rows of the action {action!r}, the table holds {there}"
            )
        return rows.reset_index(drop=True)


def episode_frame(number: int, episode: Episode, objects: tuple[str, ...]) -> pd.DataFrame:
    """Return the rows of one episode; one without samples (not started, or a record), its start.

    Parameters
    ----------
    number : int
        Number of the episode within its action.
    episode : Episode
        What was observed.
    objects : tuple of str
        The objects whose places are kept, NaN where the episode does not know them.
    """
    samples = episode.samples if len(episode.samples) else np.array([_start(episode)])
    frame = pd.DataFrame(samples, columns=_state_columns(episode))
    constants = {
        **dict.fromkeys(object_columns(name for name in objects if name not in episode.objects), np.nan),
        **_constants(episode),
        "episode": number,
        "time_to_go": episode.duration - samples[:, 0],
    }
    return frame.assign(**constants)[list(columns(objects, episode.situation.goal.values))]


def start_row(episode: Episode) -> dict[str, Any]:
    """Return the first row of an episode by column, without its number."""
    start = dict(zip(_state_columns(episode), _start(episode), strict=True))
    return {**start, **_constants(episode), "time_to_go": episode.duration}


def _state_columns(episode: Episode) -> list[str]:
    return [*STATE_COLUMNS, *object_columns(episode.objects)]


def _start(episode: Episode) -> tuple[float, ...]:
    start = World(0.0, episode.situation.robot, episode.situation.objects)
    return sample_of(start, 0.0, episode.objects)


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
    return ordered.astype({"episode": np.int32, "hold": np.int8, "success": bool})


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
    if not Path(path).is_file():
        found = "a folder, a pipe or a device" if Path(path).exists() else "no such file"
        raise ExperienceError(f"{expected}, got {found}")
    try:
        with limited_memory(_MOST_BYTES):
            metadata, wanted, table = _read_table(parquet, Path(path))
            frame = table.replace_schema_metadata(None).to_pandas()[wanted]  # pandas' own may be damaged
    except (OSError, MemoryError, UnicodeError, arrow.ArrowException) as error:
        why = "it needs too much memory" if isinstance(error, MemoryError) else printable(error, 200)
        raise ExperienceError(f"{expected}: {why}") from error
    known = metadata.get("action_set")
    return Experience(checked_rows(path, frame, DEFAULT_SET if known is None else known), metadata)


def _read_table(parquet: Any, path: Path) -> tuple[dict[str, Any], list[str], Any]:
    """Return metadata, names of columns, and columns; equal texts are stored once."""
    with parquet.ParquetFile(path) as file:
        rows, schema = file.metadata.num_rows, file.schema_arrow
    metadata, declared = _metadata(path, (schema.metadata or {}).get(_KEY))
    if rows > _MOST_ROWS:
        raise ExperienceError(f"{path}: expected at most {_MOST_ROWS} rows, got {rows}")
    wanted = list(columns(dict.fromkeys(declared.objects), dict.fromkeys(declared.goal_variables)))
    missing = [name for name in wanted if name not in schema.names]
    if missing:
        raise ExperienceError(
            f"{path}: expected the columns {', '.join(wanted)}; missing: {', '.join(missing)}"
        )
    for name in wanted:
        if schema.names.count(name) > 1:
            raise ExperienceError(f"{path}: {name}: expected one column, got {schema.names.count(name)}")
    for name in _TEXTS:
        if not _holds_text(schema.field(name).type):
            raise ExperienceError(f"{path}: {name}: expected text, got the type {schema.field(name).type}")
    with parquet.ParquetFile(path, read_dictionary=_TEXTS) as file:
        return metadata, wanted, file.read(columns=wanted)


def _holds_text(kind: Any) -> bool:
    """Return whether a column of an Arrow type holds texts."""
    arrow, _ = require_pyarrow()
    kind = kind.value_type if arrow.types.is_dictionary(kind) else kind
    return bool(arrow.types.is_string(kind) or arrow.types.is_large_string(kind))


@dataclass(frozen=True)
class _Metadata:
    """The checked metadata; a recording has no seed, and perhaps no action set."""

    objects: Annotated[tuple[Annotated[str, Name()], ...], AtMost(MOST_OBJECTS)]
    goal_variables: Annotated[tuple[Annotated[str, Name()], ...], AtMost(MOST_GOAL_VARIABLES)] = ()
    seed: int | None = None
    robot_digest: str | None = None
    domain: str | None = None
    action_set: str | None = None
    complete: bool = True
    command: str | None = None
    records_left_out: int = 0
    versions: dict[str, str] | None = None

    def __post_init__(self) -> None:
        """Check that no goal variable has the name of one that every goal has."""
        usual = set(GOAL_VARIABLES).intersection(self.goal_variables)
        require(not usual, "goal_variables", f"none of {', '.join(GOAL_VARIABLES)}", sorted(usual))


def _metadata(path: Path | str, text: bytes | None) -> tuple[dict[str, Any], _Metadata]:
    """Return the metadata as it is, which experience carries along, and as its schema."""
    try:
        metadata = content_of(json.loads(text or b"null"), KIND)
        file = structured(metadata, _Metadata)
    except SchemaError as error:
        raise ExperienceError(f"{path}: metadata.{error}") from error
    except (ValueError, RecursionError) as error:
        raise ExperienceError(f"{path}: metadata: expected JSON: {error}") from error
    return metadata, file


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
