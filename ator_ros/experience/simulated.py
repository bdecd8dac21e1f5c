"""Episodes in the simulator: one, and many in parallel, the same for any number of workers."""

from __future__ import annotations

import zlib
from collections.abc import Container, Generator, Iterable, Sequence
from functools import partial

import numpy as np
import pandas as pd

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, ActionError, Status, Step
from ator_ros.actions.goal_variables import wrong_values
from ator_ros.actions.situation import ActionSpec, Situation
from ator_ros.bases.description import Robot
from ator_ros.experience.parallel import run_tasks
from ator_ros.experience.table import Episode, ExperienceError, sample_of
from ator_ros.simulation.run import SimulatedWorld, judge, place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.chain import Top
from ator_ros.tops.library import top_of
from ator_ros.world.state import STOP, World

_TICKS_PER_SAMPLE = 2  # of 1/20 s: the paper's 10 Hz


def run_episode(
    simulation: SimulatedWorld,
    action: Action,
    situation: Situation,
    *,
    top: Top,
    time_limit: float = TIME_LIMIT,
) -> Episode:
    """Execute `action` in `situation`, tick by tick, until it ends or `time_limit` (s) is over.

    Parameters
    ----------
    simulation : SimulatedWorld
        A new simulation, in which robot and objects are placed.
    top : Top
        The TOP whose post-condition decides on success.
    """
    initial = World(0.0, situation.robot, situation.objects)
    place(simulation, initial)
    start = simulation.time
    worlds: list[World] = []

    def observed(action: Action, world: World) -> Step:
        worlds.append(world)
        return action.step(world)

    try:
        done = run_action(simulation, action, situation.goal, time_limit=time_limit, step=observed)
    except ActionError as error:
        done = Step(STOP, Status.RUNNING, f"not started: {error}")
    duration = simulation.time - start
    judgment = judge(simulation, top, situation.goal, done.status, done.message)
    seen = [sample_of(world, start, situation.objects) for world in worlds[::_TICKS_PER_SAMPLE]]
    samples = [sample for sample in seen if sample[0] < duration]
    return Episode(
        situation,
        duration,
        judgment.success,
        judgment.reason,
        judgment.error,
        judgment.heading_error,
        np.array(samples, dtype=float) if samples else None,
    )


def episode_generator(action: str, seed: int, episode: int) -> np.random.Generator:
    """Return the random generator of one episode, which depends only on these three values."""
    key = (zlib.crc32(action.encode()), episode)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _run(
    task: tuple[ActionSpec, int],
    *,
    tops: tuple[Top, ...],
    robot: Robot,
    objects: tuple[str, ...],
    seed: int,
    time_limit: float,
) -> pd.DataFrame:
    """Run the episode of this number of an action in a new simulation, and return its rows."""
    # Bullet keeps contact caches when bodies are replaced: in a used simulation, episodes with
    # contacts would differ in the sixth digit. A new simulation costs 11 ms.
    spec, number = task
    situation = spec.situation(robot, episode_generator(spec.name, seed, number))
    if wrong := wrong_values(situation.goal, spec.goal_variables):
        raise ExperienceError(f"situation of {spec.name}: goal: {wrong}")
    top = top_of(situation, tops, robot)
    with Simulation(robot) as simulation:
        action = spec.factory(robot)
        episode = run_episode(simulation, action, situation, top=top, time_limit=time_limit)
    return episode.rows(number, objects)


def collect(
    actions: Iterable[ActionSpec],
    tops: Sequence[Top],
    robot: Robot,
    *,
    objects: tuple[str, ...],
    episodes: int,
    seed: int,
    time_limit: float = TIME_LIMIT,
    finished: Container[tuple[str, int]] = (),
) -> Generator[pd.DataFrame, None, None]:
    """Yield the rows of each episode: `episodes` of each action, without those that are finished.

    Parameters
    ----------
    tops : sequence of Top
        The TOPs of the domain: their post-conditions decide on success.
    objects : tuple of str
        The objects of the domain, whose places are logged.
    time_limit : float
        Time in s that each episode may take.
    finished : container of (str, int)
        Action and number of the episodes that are left out.

    Raises
    ------
    ConfigError, ExperienceError
        A situation belongs to no TOP, or its goal lacks a variable that its action declares.
    """
    tasks = [
        (action, number)
        for action in actions
        for number in range(episodes)
        if (action.name, number) not in finished
    ]
    run = partial(
        _run, tops=tuple(tops), robot=robot, objects=objects, seed=seed, time_limit=time_limit
    )
    yield from run_tasks(run, tasks)
