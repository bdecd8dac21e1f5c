"""Many episodes in parallel, the same for the same seed whatever the number of workers."""

from __future__ import annotations

import zlib
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.goal_variables import wrong_values
from ator_ros.actions.specification import ActionSpec
from ator_ros.experience.episode import run_episode
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.parallel import run_tasks
from ator_ros.experience.table import episode_frame
from ator_ros.robot.description import Robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import Top
from ator_ros.tops.outcome import NoTopError, top_of


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
) -> Iterator[pd.DataFrame]:
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
