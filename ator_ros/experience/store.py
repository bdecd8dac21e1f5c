"""A bounded store of episodes on disk, to which a node appends while others read it.

    FOLDER/store.json                      of which robot and domain
    FOLDER/default/000000.parquet ...      closed parts of an action set, as `train` reads them
    FOLDER/default/000007.jsonl            the part that grows: one episode a line

A line is written at once, so that a process that is killed loses nothing that it has appended; `sync` brings
it to the disk. A line that was cut off is dropped when the store is opened again. Closed parts are converted
to Parquet by whoever reads them for learning (`ator_ros.experience.store_reading`).
"""

from __future__ import annotations

import itertools
import json
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import direct_name
from ator_ros.experience.columns import STATE_COLUMNS, ExperienceError, object_columns
from ator_ros.experience.episode import Episode
from ator_ros.files import is_name, load, save

KIND = "record store"
STORE = "store.json"
PART = 1000
"""Episodes of a part: what is dropped at once when the store is full."""
_UNKNOWN = (None, None)
_NUMBER = re.compile(r"(\d{6,})\.(jsonl|parquet)")


@dataclass(frozen=True)
class StoreInfo:
    """The fields of store.json: of which robot and domain all episodes are."""

    robot_digest: str
    domain: str


def read_info(folder: Path) -> StoreInfo:
    """Return of which robot and domain the episodes of a store are.

    Raises
    ------
    ExperienceError
        `folder` is no store.
    """
    return load(folder / STORE, KIND, StoreInfo, error=ExperienceError)


def parts_of(place: Path) -> dict[int, Path]:
    """Return the parts of an action set by number, in order; of a part in both formats, the converted one."""
    found: dict[int, Path] = {}
    for file in sorted(place.iterdir()) if place.is_dir() else ():  # .jsonl comes before .parquet
        if (match := _NUMBER.fullmatch(file.name)) is not None:
            found[int(match[1])] = file
    return dict(sorted(found.items()))


def line_of(episode: Episode) -> bytes:
    """Return the start of an episode as a line of JSON: columns of a table by name, null where not known."""
    robot, goal = episode.situation.robot, episode.situation.goal
    there = episode.situation.objects
    places = [(there[name].x, there[name].y) if name in there else _UNKNOWN for name in episode.objects]
    row = {
        "action": episode.situation.action,
        "t": 0.0,
        **dict(zip(STATE_COLUMNS[1:], (*robot.pose, robot.v, robot.w), strict=True)),
        **dict(zip(object_columns(episode.objects), itertools.chain.from_iterable(places), strict=True)),
        "xg": goal.pose.x,
        "yg": goal.pose.y,
        "yawg": goal.pose.yaw,
        "speedg": goal.speed,
        **{direct_name(name): value for name, value in goal.values.items()},
        "hold": int(goal.point is Point.HOLD),
        "time_to_go": episode.duration,
        "duration": episode.duration,
        "success": episode.success,
        "reason": episode.reason,
        "position_error": episode.position_error,
        "heading_error": episode.heading_error,
    }
    plain = {name: None if value != value else value for name, value in row.items()}  # NaN
    return json.dumps(plain, allow_nan=False, separators=(",", ":")).encode() + b"\n"


class RecordStore:
    """Appends episodes; what is oldest makes room for what is new.

    One process at a time may append: see `ator_ros.learning.sets.locked`.

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
    ExperienceError
        The folder is a store of another robot or domain.
    OSError
        It cannot be written.
    """

    def __init__(self, folder: Path, info: StoreInfo, *, most: int) -> None:
        self._folder, self._most = folder, most
        folder.mkdir(parents=True, exist_ok=True)
        if (folder / STORE).exists():
            if (there := read_info(folder)) != info:
                raise ExperienceError(
                    f"{folder / STORE}: expected {info}, got {there}: choose another folder"
                )
        else:
            save(folder / STORE, KIND, info)
        self._open: dict[str, _Part] = {}
        for place in sorted(folder.iterdir()):
            if place.is_dir() and is_name(place.name):
                self._open[place.name] = _last_part(place)

    @property
    def ends(self) -> dict[str, int]:
        """The number that the next episode of each action set gets; numbers are never used twice."""
        return {name: part.number * PART + part.lines for name, part in self._open.items()}

    def append(self, action_set: str, episode: Episode) -> None:
        """Append an episode; it is written whole or, when OSError is raised, not at all."""
        line = line_of(episode)
        part = self._open.get(action_set)
        if part is None:
            (self._folder / action_set).mkdir(exist_ok=True)
            part = _last_part(self._folder / action_set)
        elif part.lines >= PART:
            part.sync()
            part.close()
            part = _Part(part.place, part.number + 1)
            self._open[action_set] = part
            self._drop_oldest(part)
        part.append(line)
        self._open[action_set] = part

    def sync(self) -> None:
        """Bring what was appended to the disk, so that it outlasts a loss of power."""
        for part in self._open.values():
            part.sync()

    def close(self) -> None:
        """Close the files."""
        for part in self._open.values():
            part.close()

    def _drop_oldest(self, newest: _Part) -> None:
        kept = math.ceil(self._most / PART)
        for number in parts_of(newest.place):
            if number < newest.number - kept:
                for suffix in ("jsonl", "parquet"):
                    (newest.place / f"{number:06d}.{suffix}").unlink(missing_ok=True)


def _last_part(place: Path) -> _Part:
    """Return the part of an action set that grows: the last one, or the one after where that is converted."""
    parts = parts_of(place)
    if not parts:
        return _Part(place, 0)
    number, file = next(reversed(parts.items()))
    return _Part(place, number + (file.suffix == ".parquet"))


class _Part:
    """The part that grows; opened when the first line is appended."""

    def __init__(self, place: Path, number: int) -> None:
        self.place, self.number = place, number
        self._file = place / f"{number:06d}.jsonl"
        self._handle = -1
        self._dirty = False
        self._size, self.lines = _whole_lines(self._file)

    def append(self, line: bytes) -> None:
        handle = self._opened()
        try:
            written = os.write(handle, line)
            if written < len(line):  # the disk is full
                written += os.write(handle, line[written:])
            if written < len(line):
                raise OSError(28, os.strerror(28), str(self._file))
        except OSError:
            os.ftruncate(handle, self._size)
            raise
        self._size, self.lines, self._dirty = self._size + len(line), self.lines + 1, True

    def sync(self) -> None:
        if self._dirty:
            os.fsync(self._handle)
            self._dirty = False

    def close(self) -> None:
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def _opened(self) -> int:
        if self._handle < 0:
            flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
            self._handle = os.open(self._file, flags, 0o644)
            os.ftruncate(self._handle, self._size)  # a line that was cut off
        return self._handle


def _whole_lines(file: Path) -> tuple[int, int]:
    """Return the size in bytes up to the end of the last whole line, and the number of lines."""
    if not file.exists():
        return 0, 0
    with file.open("rb") as opened:
        lengths = [len(line) for line in opened if line.endswith(b"\n")]
    return sum(lengths), len(lengths)
