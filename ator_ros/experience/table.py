"""Episodes, and experience as one table of their rows at 10 Hz, in Parquet (paper, section 3)."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import MOST_GOAL_VARIABLES, direct_name
from ator_ros.actions.situation import Situation
from ator_ros.bases.drive_parts import DriveParts, parts_of_drive
from ator_ros.files import atomic_write, content_of, header, is_name
from ator_ros.geometry import FloatArray
from ator_ros.printable import ReadableError, listed, printable, quoted
from ator_ros.schema import SchemaError, require
from ator_ros.world.readers import MOST_OBJECTS
from ator_ros.world.state import World


class ExperienceError(ReadableError, ValueError):
    """Experience cannot be used; the message names the file, the field and the expected value."""

    longest = 600  # names topics of recordings and columns of tables beside what was expected


_MOST_ROWS = 2_000_000  # of a table: 55 h at 10 Hz, which need about 1 GB
LARGEST = 1e9
"""Greatest number in a table: thirty years in s; in m it exceeds `world.messages.FARTHEST`."""


class Column(NamedTuple):
    """A column: what it means, the range of its numbers, and whether NaN is allowed."""

    meaning: str
    low: float = -LARGEST
    high: float = LARGEST
    may_be_nan: bool = False


_STATE = {
    "t": Column("s since the start of the episode", 0.0),
    "x": Column("m, axle"),
    "y": Column("m, axle"),
    "yaw": Column("rad"),
    "v": Column("m/s, forward"),
    "w": Column("rad/s, counter-clockwise"),
    "vy": Column("m/s, to the left"),
}
_BEFORE = {
    "action": Column("name of the action"),
    "episode": Column("number of the episode within its action", 0.0),
    **_STATE,
}
_GOAL = {
    "xg": Column("m, goal of the axle (hold 0) or of the hold (hold 1)"),
    "yg": Column("m, goal of the axle (hold 0) or of the hold (hold 1)"),
    "yawg": Column("rad, heading at the goal"),
    "speedg": Column("m/s, forward speed at the goal", 0.0),
}
_PARTS = {
    "first_turn": Column(
        "s until the robot had driven 5 cm; NaN if unknown, as in drives below 10 cm",
        may_be_nan=True,
    ),
    "last_turn": Column(
        "s from when 5 cm of the drive were left until the action ended; NaN if unknown",
        may_be_nan=True,
    ),
    "driven": Column(
        "m, forward minus backward, by odometry; NaN if unknown",
        may_be_nan=True,
    ),
}
_AFTER = {
    "hold": Column(
        "1: (xg, yg) is the goal of the hold, the place in front where objects are held; "
        "0: of the axle",
        0.0,
        1.0,
    ),
    "time_to_go": Column("s until the action ended", 0.0),
    "duration": Column("s, of the whole episode", 0.0),
    "success": Column(
        "the action ended well, and the post-condition of its TOP holds",
        0.0,
        1.0,
    ),
    "reason": Column("how the episode ended"),
    **_PARTS,
    "position_error": Column("m, at the end; where it passed the least one", 0.0, may_be_nan=True),
    "nearer": Column(
        "m by which it still came nearer to a goal that it passed after the next action took over; "
        "NaN of others",
        0.0,
        may_be_nan=True,
    ),
    "heading_error": Column(
        "rad, at the end; NaN where the heading does not matter",
        0.0,
        may_be_nan=True,
    ),
}
STATE_COLUMNS = tuple(_STATE)
"""Time and the robot's state, in the order of a sample."""
_TEXTS = ("action", "reason")
_TYPES = {"episode": np.int32, "hold": np.int8, "success": bool}
"""Columns of whole numbers and of true and false; all other numbers are floats."""


def columns(objects: Iterable[str], goal_variables: Iterable[str] = ()) -> dict[str, Column]:
    """Return the columns of a table by name; SI units, world frame.

    `objects` are those whose places it has, `goal_variables` are declared by actions beyond pose
    and speed.
    """
    found = dict(_BEFORE)
    for name in object_columns(objects):
        found[name] = Column(f"m, NaN without {name.rpartition('_')[0]}", may_be_nan=True)
    found |= _GOAL
    for name in goal_variables:
        meaning = f"goal variable {name} in its declared unit, NaN of an action without it"
        found[direct_name(name)] = Column(meaning, may_be_nan=True)
    return found | _AFTER


def object_columns(objects: Iterable[str]) -> list[str]:
    """Return the names of the columns of objects: NAME_x and NAME_y of each."""
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


def columns_among(names: Iterable[str]) -> dict[str, Column]:
    """Return `columns` for the objects and goal variables whose columns are among `names`."""
    names = list(names)
    return columns(objects_of_columns(names), goal_variables_of_columns(names))


# An episode


@dataclass(frozen=True, slots=True)
class Episode:
    """One observed execution of an action (paper, section 3).

    Attributes
    ----------
    situation : Situation
        Start and goal.
    duration : float
        From the start to when the action ended, in s.
    success : bool
        The action ended well, and the TOP's post-condition truly holds.
    reason : str
        How it ended, in a sentence.
    position_error, heading_error : float
        Distance in m and angle in rad to the goal at the end, of the axle or the hold. If the TOP
        does not place the robot: how far the world is from the post-condition, and NaN.
    samples : ndarray, shape (n, k), or None
        The states at 10 Hz from the start until before the end, see `sample_of`; None: only the
        start is known.
    parts : DriveParts or None
        By odometry; None: computed from `samples`.
    nearer : float
        By how much in m it still came nearer to a goal that it passed after the next action took
        over; NaN: unknown, or it stopped.
    """

    situation: Situation
    duration: float
    success: bool
    reason: str
    position_error: float
    heading_error: float
    samples: FloatArray | None = None
    parts: DriveParts | None = None
    nearer: float = math.nan

    def rows(self, number: int, objects: Iterable[str]) -> pd.DataFrame:
        """Return its rows in a table, as the episode with this number within its action.

        `objects` are those whose places are kept, NaN in an episode without them.
        """
        start = self.situation
        samples = self.samples
        if samples is None:
            world = World(0.0, start.robot, start.objects)
            samples = np.array([sample_of(world, 0.0, start.objects)])
        names = [*STATE_COLUMNS, *object_columns(start.objects)]
        frame = pd.DataFrame(samples, columns=names)
        parts = self.parts
        if parts is None:
            parts = parts_of_drive(frame["t"].to_numpy(), frame["v"].to_numpy(), self.duration)
        wanted = columns(objects, start.goal.values)
        return frame.assign(
            action=start.action,
            episode=number,
            xg=start.goal.pose.x,
            yg=start.goal.pose.y,
            yawg=start.goal.pose.yaw,
            speedg=start.goal.speed,
            hold=int(start.goal.point is Point.HOLD),
            time_to_go=self.duration - frame["t"],
            duration=self.duration,
            success=self.success,
            reason=self.reason,
            position_error=self.position_error,
            nearer=self.nearer,
            heading_error=self.heading_error,
            **{direct_name(name): value for name, value in start.goal.values.items()},
            **parts._asdict(),
        ).reindex(columns=list(wanted))


def sample_of(world: World, start: float, objects: Iterable[str]) -> tuple[float, ...]:
    """Return a sample of an episode that started at `start` (s).

    It has the columns `STATE_COLUMNS`, then x and y in m of each object, NaN where unknown.
    """
    robot = world.robot
    sample = [world.time - start, *robot.pose, robot.vx, robot.w, robot.vy]
    for name in objects:
        there = world.objects.get(name)
        sample += (math.nan, math.nan) if there is None else (there.x, there.y)
    return tuple(sample)


# The table

KIND = "experience"
_KEY = b"ator_ros"


def checked_rows(source: Path | str, frame: pd.DataFrame, action_set: object) -> pd.DataFrame:
    """Check rows of experience, of any types, and return their known columns with plain types.

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
    objects = objects_of_columns(frame.columns)
    declared = goal_variables_of_columns(frame.columns)
    wanted = columns(objects, declared)
    has_parts = {*_PARTS} <= {*frame.columns}
    if not has_parts:
        frame = frame.assign(**DriveParts()._asdict())
    if "vy" not in frame:  # as in tables of version 0.1
        frame = frame.assign(vy=0.0)
    if "nearer" not in frame:
        frame = frame.assign(nearer=math.nan)
    if missing := [name for name in wanted if name not in frame.columns]:
        raise ExperienceError(
            f"{source}: expected the columns {', '.join(wanted)}; missing: {', '.join(missing)}"
        )
    if frame.empty:
        raise ExperienceError(f"{source}: expected rows of experience, found none")
    names = [("action_set", action_set)]
    names += [("action", name) for name in frame["action"].unique()]
    names += [("column", name) for name in (*objects, *declared)]
    for field, name in names:
        if not is_name(name):
            expected = "expected a name of letters, digits and _"
            raise ExperienceError(f"{source}: {field}: {expected}, got {quoted(name)}")
    if len(objects) > MOST_OBJECTS or len(declared) > MOST_GOAL_VARIABLES:
        most = f"at most {MOST_OBJECTS} objects and {MOST_GOAL_VARIABLES} goal variables"
        raise ExperienceError(f"{source}: expected {most}, got {len(objects)} and {len(declared)}")
    checked = {}
    for name, column in wanted.items():
        values = frame[name]
        is_text = name in _TEXTS
        checked[name] = values.astype(object) if is_text else _numbers(source, values, column)
    rows = pd.DataFrame(checked).astype(_TYPES)
    return rows if has_parts else _with_parts(rows)


def _with_parts(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows of a table of version 0.1 with the parts of their drives."""

    def parts_of(drive: pd.DataFrame) -> pd.DataFrame:
        duration = drive["duration"].iloc[0]
        parts = parts_of_drive(drive["t"].to_numpy(), drive["v"].to_numpy(), duration)
        return drive.assign(**parts._asdict())

    drives = rows.groupby(["action", "episode"], sort=False)
    return pd.concat([parts_of(drive) for _, drive in drives]).sort_index()


def _numbers(source: Path | str, values: pd.Series, column: Column) -> FloatArray:
    """Return the numbers of a column of any numeric type, checked."""
    name = str(values.name)
    kind = "whole numbers" if name in _TYPES else "numbers"
    expected = f"{source}: {name}: expected {kind} from {column.low:g} to {column.high:g}"
    if not pd.api.types.is_numeric_dtype(values):
        raise ExperienceError(f"{expected}, got the type {values.dtype}")
    numbers: FloatArray = values.to_numpy(dtype=float, na_value=np.nan)
    good = (numbers >= column.low) & (numbers <= column.high)
    if column.may_be_nan:
        good |= np.isnan(numbers)
    if name in _TYPES:
        good &= numbers == np.round(numbers)
    if not good.all():
        row = int(np.argmin(good))
        raise ExperienceError(f"{expected}, got {numbers[row]:g} in row {row}")
    return numbers


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
    known = columns_among(experience.frame.columns)
    meanings = {name: column.meaning for name, column in known.items()}
    metadata = {
        **header(KIND),
        "columns": meanings,
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
            names = file.schema_arrow.names
            rows = file.metadata.num_rows
            if len(set(names)) < len(names):
                raise ExperienceError(f"{path}: expected each column once, got {listed(names)}")
            if rows > _MOST_ROWS:
                raise ExperienceError(
                    f"{path}: expected at most {_MOST_ROWS:,} rows, got {rows:,}: split the table"
                )
            text = (file.schema_arrow.metadata or {}).get(_KEY) or b"null"
            table = file.read(columns=list(columns_among(names)))
            frame = table.replace_schema_metadata(None).to_pandas()  # pandas' own may be damaged
    except (OSError, UnicodeError, pa.ArrowException) as error:
        raise ExperienceError(f"{expected}: {printable(error, 200)}") from error
    try:
        metadata = content_of(json.loads(text), KIND)
        seed = metadata.get("seed")
        is_seed = seed is None or (type(seed) is int and seed >= 0)
        require(is_seed, "seed", "a whole number of at least 0", seed)
    except SchemaError as error:
        raise ExperienceError(f"{path}: metadata.{error}") from error
    except (ValueError, RecursionError) as error:
        raise ExperienceError(f"{path}: metadata: expected JSON: {error}") from error
    return Experience(
        checked_rows(path, frame, metadata.get("action_set") or DEFAULT_SET), metadata
    )
