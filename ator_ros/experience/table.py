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

from ator_ros.actions.base import Point
from ator_ros.experience.episode import SAMPLE_COLUMNS, Episode
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.validation import checked_rows
from ator_ros.files import limited_memory, replaced
from ator_ros.robot.ball import ball_of
from ator_ros.schema import Format, SchemaError, structured

FORMAT = Format("ator_ros experience", 1, "experience")
_KEY = b"ator_ros"
_MOST_ROWS = 5_000_000  # 30 times those of a thousand episodes of each action
_MOST_BYTES = 4_000_000_000  # of memory

COLUMNS: dict[str, str] = {
    "action": "name of the action",
    "episode": "number of the episode within its action",
    "t": "s since the start of the episode",
    "x": "m, axle",
    "y": "m, axle",
    "yaw": "rad",
    "v": "m/s, forward",
    "w": "rad/s, counter-clockwise",
    "ball_x": "m, NaN without a ball",
    "ball_y": "m, NaN without a ball",
    "xg": "m, goal of the axle (hold 0) or of the ball (hold 1)",
    "yg": "m, goal of the axle (hold 0) or of the ball (hold 1)",
    "yawg": "rad, heading at the goal",
    "speedg": "m/s, forward speed at the goal",
    "hold": "1: the ball's place in the robot's front shall come to (xg, yg); 0: the axle",
    "time_to_go": "s until the action ended",
    "duration": "s, of the whole episode",
    "success": "the action ended well and did what it is for",
    "reason": "how the episode ended",
    "position_error": "m, at the end",
    "heading_error": "rad, at the end; NaN where the heading does not matter",
}
"""Name and meaning of each column; SI units, world frame."""


@dataclass(frozen=True)
class Experience:
    """Examples and where they come from.

    Attributes
    ----------
    frame : pandas.DataFrame
        The columns of COLUMNS; the rows of an episode of an action together, in the order of time.
    metadata : dict
        How it was made: seed, robot digest, action set, command, versions.
    """

    frame: pd.DataFrame
    metadata: dict[str, Any]

    @property
    def seed(self) -> int:
        """The seed that it was collected with; 0 for a recording, which has none."""
        seed = self.metadata.get("seed")
        return seed if isinstance(seed, int) else 0

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


def episode_frame(number: int, episode: Episode) -> pd.DataFrame:
    """Return the rows of one episode; one without samples (not started, or a record), its start."""
    goal = episode.situation.goal
    samples = episode.samples
    if len(samples) == 0:
        start, ball = episode.situation.robot, ball_of(episode.situation)
        place = (ball.x, ball.y) if ball is not None else (np.nan, np.nan)
        samples = np.array([(0.0, *start.pose, start.v, start.w, *place)])
    frame = pd.DataFrame(samples, columns=list(SAMPLE_COLUMNS))
    constants = {
        "action": episode.situation.action,
        "episode": number,
        "xg": goal.pose.x,
        "yg": goal.pose.y,
        "yawg": goal.pose.yaw,
        "speedg": goal.speed,
        "hold": int(goal.point is Point.HOLD),
        "time_to_go": episode.duration - samples[:, 0],
        "duration": episode.duration,
        "success": episode.success,
        "reason": episode.reason,
        "position_error": episode.position_error,
        "heading_error": episode.heading_error,
    }
    return frame.assign(**constants)[list(COLUMNS)]


def join(frames: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Join frames of episodes into one table with the column types of the file."""
    parts = list(frames)
    if not parts:
        return pd.DataFrame({name: pd.Series(dtype=float) for name in COLUMNS})
    return pd.concat(parts, ignore_index=True).astype({"episode": np.int32, "hold": np.int8, "success": bool})


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
    metadata = {**FORMAT.head(), "columns": COLUMNS, **experience.metadata}
    text = json.dumps(metadata, sort_keys=True).encode()
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), _KEY: text})
    with replaced(path) as temporary:
        parquet.write_table(table, temporary, compression="zstd")


def read_experience(path: Path | str) -> Experience:
    """Read a table that `write_experience` wrote.

    Raises
    ------
    ExperienceError
        The file is missing, damaged, not experience, newer than this program, lacks a column, or a value
        in it is not what its column holds.
    """
    arrow, parquet = require_pyarrow()
    if not Path(path).exists():
        raise ExperienceError(f"{path}: expected a Parquet file with experience: there is no such file")
    try:
        with limited_memory(_MOST_BYTES):
            table = _read_table(parquet, Path(path))
    except (OSError, MemoryError, arrow.ArrowException) as error:
        raise ExperienceError(f"{path}: expected a Parquet file with experience: {error}") from error
    metadata = _metadata(path, (table.schema.metadata or {}).get(_KEY))
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise ExperienceError(
            f"{path}: expected the columns {', '.join(COLUMNS)}; missing: {', '.join(missing)}"
        )
    frame = table.replace_schema_metadata(None).to_pandas()[list(COLUMNS)]  # pandas' own may be damaged
    return Experience(checked_rows(path, frame, metadata.get("action_set", "default")), metadata)


def _read_table(parquet: Any, path: Path) -> Any:
    """Read the columns of COLUMNS, those that there are; texts once each, however often they are used."""
    with parquet.ParquetFile(path, read_dictionary=["action", "reason"]) as file:
        rows, names = file.metadata.num_rows, file.schema_arrow.names
        if rows > _MOST_ROWS:
            raise ExperienceError(f"{path}: expected at most {_MOST_ROWS} rows, got {rows}")
        return file.read(columns=[name for name in COLUMNS if name in names])


@dataclass(frozen=True)
class _Metadata:
    """The metadata that is used; a recording has no seed, and perhaps no action set."""

    seed: int | None = None
    robot_digest: str | None = None
    domain: str | None = None
    action_set: str | None = None
    complete: bool = True
    command: str | None = None
    records_left_out: int = 0
    versions: dict[str, str] | None = None


def _metadata(path: Path | str, text: bytes | None) -> dict[str, Any]:
    try:
        metadata = FORMAT.current(json.loads(text or b"null"))
        structured(metadata, _Metadata)
    except SchemaError as error:
        raise ExperienceError(f"{path}: metadata.{error}") from error
    except (ValueError, RecursionError) as error:
        raise ExperienceError(f"{path}: metadata: expected JSON: {error}") from error
    return metadata


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
