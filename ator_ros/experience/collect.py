"""Collect episodes in parallel: the same for the same seed, whatever the number of workers.

Each is kept in a file until the table is written, so that an interrupted collection can resume.
"""

from __future__ import annotations

import zlib
from collections.abc import Container, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.goal_variables import wrong_values
from ator_ros.actions.specification import ActionSpec
from ator_ros.experience.columns import ExperienceError, columns
from ator_ros.experience.episode import run_episode
from ator_ros.experience.parallel import PartialResults, run_tasks
from ator_ros.experience.table import checked_rows, episode_frame, join
from ator_ros.robot.description import Robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import Top
from ator_ros.tops.outcome import NoTopError, top_of


class FinishedEpisodes:
    """The episodes of a collection, in a file beside the table until that is written.

    Parameters
    ----------
    table : Path
        File of the table that the episodes will be written to.
    identity : mapping
        What the episodes depend on, see `PartialResults`.

    Attributes
    ----------
    path : Path
        The file.
    frames : dict
        The rows of each episode by action and number.

    Raises
    ------
    ExperienceError, OSError
        See `PartialResults`.
    """

    def __init__(self, table: Path, identity: Mapping[str, Any]) -> None:
        self.path = table.with_suffix(".episodes.jsonl")
        expected = "episodes of the same seed, robot, domain, action set and versions"
        self._file = PartialResults(self.path, identity, expected, ExperienceError)
        try:
            frames = [_frame_of(result) for result in self._file.results]
            if frames:
                checked_rows(self.path, join(frames), "default")
        except ValueError as error:
            raise ExperienceError(f"{self.path}: expected {expected}: {error}") from error
        self.frames = {(frame["action"].iloc[0], int(frame["episode"].iloc[0])): frame for frame in frames}

    def add(self, frame: pd.DataFrame) -> None:
        """Keep the rows of one more episode; raises OSError if they cannot be written."""
        row = frame.iloc[0]
        self.frames[row["action"], int(row["episode"])] = frame
        self._file.append({name: _plain(frame[name]) for name in frame.columns})

    def __enter__(self) -> Self:
        """Return this object, whose file is closed when the block ends."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file; delete it if it holds no episode."""
        with self._file:
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


def _frame_of(result: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rows of a kept episode; raises ValueError if it is none."""
    if missing := sorted(columns(()).keys() - result.keys()):
        raise ValueError(f"an episode lacks {', '.join(missing)}")
    if not (isinstance(result["action"], str) and type(result["episode"]) is int):
        raise ValueError("expected a name as action and a whole number as episode")
    rows = max((len(values) for values in result.values() if isinstance(values, list)), default=1)
    return pd.DataFrame(
        {name: values if isinstance(values, list) else [values] * rows for name, values in result.items()}
    )


@dataclass(frozen=True)
class EpisodeTask:
    """Everything that one episode depends on.

    Attributes
    ----------
    action : ActionSpec
        The action, and how its situations are drawn.
    tops : tuple of Top
        The TOPs of the domain; the post-condition of one of them decides on success.
    robot : Robot
        Shape and limits.
    seed, episode : int
        Seed of the collection, and number of the episode in it.
    objects : tuple of str
        The objects whose places are logged.
    time_limit : float
        Time in s that the action may take.
    """

    action: ActionSpec
    tops: tuple[Top, ...]
    robot: Robot
    seed: int
    episode: int
    objects: tuple[str, ...] = ()
    time_limit: float = TIME_LIMIT


def episode_generator(action: str, seed: int, episode: int) -> np.random.Generator:
    """Return the random generator of one episode, which depends on nothing but these three."""
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
        The actions, and how their situations are drawn.
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
