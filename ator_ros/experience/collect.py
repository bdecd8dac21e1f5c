"""Many episodes in parallel, the same for the same seed whatever the number of workers."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ator_ros.actions.base import Action
from ator_ros.experience.episode import TIME_LIMIT, run_episode
from ator_ros.experience.parallel import run_tasks
from ator_ros.experience.situations import Situation, random_situation
from ator_ros.experience.table import episode_frame
from ator_ros.robot.description import Robot
from ator_ros.simulation.pioneer import PioneerSimulation

ActionFactory = Callable[[Robot], Action]
Sampler = Callable[[str, Robot, np.random.Generator], Situation]


@dataclass(frozen=True)
class EpisodeTask:
    """Everything that one episode depends on, so that it runs the same in any worker.

    Attributes
    ----------
    action : str
        Name of the action.
    factory : callable
        Makes the action for a robot: its class.
    robot : Robot
        Shape, limits, ball and field.
    seed, episode : int
        Of the collection, and the number of the episode in it.
    sample : callable
        Draws the situation.
    time_limit : float
        In s.
    """

    action: str
    factory: ActionFactory
    robot: Robot
    seed: int
    episode: int
    sample: Sampler = random_situation
    time_limit: float = TIME_LIMIT


def episode_generator(action: str, seed: int, episode: int) -> np.random.Generator:
    """Return the source of chance of one episode: it depends on these three and nothing else."""
    key = (zlib.crc32(action.encode()), episode)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def run_task(task: EpisodeTask) -> pd.DataFrame:
    """Run one episode in a world of its own and give its rows.

    Bullet keeps contact caches over replacements of the bodies: in a world used before, an episode with
    a ball differs in the sixth digit. A new world costs 11 ms.
    """
    situation = task.sample(task.action, task.robot, episode_generator(task.action, task.seed, task.episode))
    with PioneerSimulation(task.robot) as simulation:
        episode = run_episode(simulation, task.factory(task.robot), situation, time_limit=task.time_limit)
    return episode_frame(task.episode, episode)


def collect(
    factories: Mapping[str, ActionFactory],
    robot: Robot,
    *,
    episodes: int,
    seed: int,
    jobs: int = 1,
    backend: str = "loky",
    sample: Sampler = random_situation,
) -> Iterator[pd.DataFrame]:
    """Yield the rows of episode after episode: `episodes` of each action of `factories`.

    Parameters
    ----------
    factories : mapping
        Classes of actions by their names.
    robot : Robot
        Shape, limits, ball and field.
    episodes, seed : int
        Episodes of each action, and the seed of all of them.
    jobs, backend
        As for `run_tasks`.
    sample : callable
        Draws the situations.
    """
    tasks = [
        EpisodeTask(name, factory, robot, seed, number, sample)
        for name, factory in factories.items()
        for number in range(episodes)
    ]
    yield from run_tasks(run_task, tasks, jobs=jobs, backend=backend)
