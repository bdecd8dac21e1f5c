"""Many episodes in parallel, the same for the same seed whatever the number of workers.

Each is kept in a file until the table is written, so that a collection continues where it was interrupted.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Container, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.goal_variables import wrong_values
from ator_ros.actions.specification import ActionSpec
from ator_ros.experience.columns import ExperienceError, columns
from ator_ros.experience.episode import run_episode
from ator_ros.experience.parallel import run_tasks
from ator_ros.experience.table import checked_rows, episode_frame, join
from ator_ros.files import is_locked_elsewhere, read_text
from ator_ros.printable import short
from ator_ros.robot.description import Robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import Top
from ator_ros.tops.outcome import NoTopError, top_of

_LARGEST = 2_000_000_000
"""Bytes of a file that is read: an episode takes about 10 kB."""


class FinishedEpisodes:
    """The episodes of a collection, one a line in a file beside the table.

    The same collection continues after them, however its process ended. The first line holds what the
    episodes depend on. A line that was cut off is dropped.

    Parameters
    ----------
    table : Path
        File of the table that the episodes will be written to.
    identity : mapping
        What the episodes depend on, as JSON can hold it.

    Attributes
    ----------
    path : Path
        The file.
    frames : dict
        The rows of each episode by action and number.

    Raises
    ------
    ExperienceError
        The file holds other episodes, is damaged, or another process writes it.
    OSError
        It cannot be written.
    """

    def __init__(self, table: Path, identity: Mapping[str, Any]) -> None:
        self.path = table.with_suffix(".episodes.jsonl")
        self.frames: dict[tuple[str, int], pd.DataFrame] = {}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        head = json.dumps(identity, sort_keys=True)
        try:
            text = read_text(self.path, _LARGEST) if self.path.exists() else ""
            lines = text.split("\n")[:-1]
            there, lines = "".join(lines[:1]), lines[1:]
            frames = [_frame_in(line) for line in lines]
            if frames:
                checked_rows(self.path, join(frames), "default")
        except (ValueError, RecursionError) as error:
            raise ExperienceError(f"{self.path}: expected episodes, one a line: {error}") from error
        if there not in ("", head):
            raise ExperienceError(
                f"{self.path}: expected episodes of the same seed, robot, domain, action set and "
                "versions, got others: choose another --out, or delete that file"
            )
        self._file = self.path.open("ab")
        if is_locked_elsewhere(self._file.fileno()):
            self._file.close()
            raise ExperienceError(f"{self.path}: expected a file of its own, another command is writing it")
        self._size = len("".join(f"{line}\n" for line in (there, *lines) if line).encode())
        os.truncate(self.path, self._size)
        if not there:
            self._append(head)
        self.frames = {(frame["action"].iloc[0], int(frame["episode"].iloc[0])): frame for frame in frames}

    def add(self, frame: pd.DataFrame) -> None:
        """Keep the rows of one more episode; raises OSError if they cannot be written."""
        row = frame.iloc[0]
        self.frames[row["action"], int(row["episode"])] = frame
        self._append(json.dumps({name: _plain(frame[name]) for name in frame.columns}))

    def _append(self, line: str) -> None:
        """Write a line whole or, where OSError is raised, not at all."""
        data = line.encode() + b"\n"
        try:
            self._file.write(data)
            self._file.flush()
        except OSError:
            os.truncate(self.path, self._size)
            raise
        self._size += len(data)

    def close(self) -> None:
        """Close the file; delete it if it holds no episode."""
        self._file.close()
        if not self.frames:
            self.remove()

    def remove(self) -> None:
        """Delete the file: the table is written."""
        self.path.unlink(missing_ok=True)


def _plain(column: pd.Series) -> Any:
    """Return the values of a column; of a constant one, its value."""
    values = column.tolist()
    constant = column.nunique(dropna=False) == 1
    return values[0] if constant else values


def _frame_in(line: str) -> pd.DataFrame:
    """Return the rows of an episode; raises ValueError if the line holds none."""
    data = json.loads(line)
    if not isinstance(data, dict) or (missing := sorted(columns(()).keys() - data.keys())):
        raise ValueError(f"{short(line)} {f'lacks {missing}' if isinstance(data, dict) else 'is no episode'}")
    if not (isinstance(data["action"], str) and type(data["episode"]) is int):
        raise ValueError(f"{short(line)}: expected a name as action and a whole number as episode")
    rows = max((len(values) for values in data.values() if isinstance(values, list)), default=1)
    return pd.DataFrame(
        {name: values if isinstance(values, list) else [values] * rows for name, values in data.items()}
    )


@dataclass(frozen=True)
class EpisodeTask:
    """Everything that one episode depends on, so that it runs the same in any worker.

    Attributes
    ----------
    action : ActionSpec
        The action, and how its situations are drawn.
    tops : tuple of Top
        The TOPs of the domain, one of which says what an episode is for.
    robot : Robot
        Shape and limits.
    seed, episode : int
        Of the collection, and the number of the episode in it.
    objects : tuple of str
        The objects whose places are logged.
    time_limit : float
        In s.
    """

    action: ActionSpec
    tops: tuple[Top, ...]
    robot: Robot
    seed: int
    episode: int
    objects: tuple[str, ...] = ()
    time_limit: float = TIME_LIMIT


def episode_generator(action: str, seed: int, episode: int) -> np.random.Generator:
    """Return the source of chance of one episode: it depends on these three and nothing else."""
    key = (zlib.crc32(action.encode()), episode)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def run_task(task: EpisodeTask) -> pd.DataFrame:
    """Run one episode in a world of its own and return its rows.

    Bullet keeps contact caches over replacements of the bodies: in a world used before, an episode with
    contacts differs in the sixth digit. A new world costs 11 ms.
    """
    rng = episode_generator(task.action.name, task.seed, task.episode)
    situation = task.action.sample(task.robot, rng)
    if wrong := wrong_values(situation.goal, task.action.goal_variables):
        raise ExperienceError(f"situation of {task.action.name}: goal: {wrong}")
    try:
        top = top_of(situation, task.tops, task.robot)
    except NoTopError as error:
        raise ExperienceError(str(error)) from error
    with Simulation(task.robot) as simulation:
        action = task.action.factory(task.robot)
        episode = run_episode(simulation, action, situation, top=top, time_limit=task.time_limit)
    return episode_frame(task.episode, episode, task.objects)


def collect(
    actions: Iterable[ActionSpec],
    tops: Sequence[Top],
    robot: Robot,
    *,
    objects: tuple[str, ...],
    episodes: int,
    seed: int,
    jobs: int = 1,
    backend: str = "loky",
    time_limit: float = TIME_LIMIT,
    finished: Container[tuple[str, int]] = (),
) -> Generator[pd.DataFrame, None, None]:
    """Yield the rows of episode after episode: `episodes` of each action, without those that are finished.

    Parameters
    ----------
    actions : iterable of ActionSpec
        What to execute, and how situations are drawn.
    tops : sequence of Top
        The TOPs of the domain: their post-conditions decide on success.
    robot : Robot
        Shape and limits.
    objects : tuple of str
        The objects whose places are logged: those of the domain.
    episodes, seed : int
        Episodes of each action, and the seed of all of them.
    jobs, backend
        As for `run_tasks`.
    time_limit : float
        Time in s that each may take.
    finished : container of (str, int)
        Action and number of the episodes that are left out.

    Raises
    ------
    ExperienceError
        A situation belongs to none of the TOPs, or its goal lacks a variable that its action declares.
    """
    purposes, numbers = tuple(tops), range(episodes)
    tasks = [
        EpisodeTask(action, purposes, robot, seed, number, objects, time_limit)
        for action in actions
        for number in numbers
        if (action.name, number) not in finished
    ]
    yield from run_tasks(run_task, tasks, jobs=jobs, backend=backend)
