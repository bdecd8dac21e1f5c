"""Episodes in the simulator: one, and many in parallel, the same for any number of workers."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Container, Generator, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, ActionError, Goal, Status, Step
from ator_ros.actions.goal_variables import (
    STOP,
    STOPS,
    goals_to_stop,
    passes,
    with_values,
    wrong_values,
)
from ator_ros.actions.situation import ActionSpec, Situation
from ator_ros.bases.description import Robot
from ator_ros.experience.parallel import run_tasks
from ator_ros.experience.table import Episode, ExperienceError, sample_of
from ator_ros.geometry import FloatArray
from ator_ros.simulation.run import SimulatedWorld, judge, place, run
from ator_ros.simulation.scene_simulation import CONTROL_RATE, Simulation
from ator_ros.tops.chain import Top
from ator_ros.tops.library import top_of
from ator_ros.world.state import STOP as STANDING
from ator_ros.world.state import World

_TICKS_PER_SAMPLE = 2  # of 1/20 s: the paper's 10 Hz
_LEGS = 4  # episodes that follow each other: three of four may begin in passing

Key = tuple[str, int]
"""Action and number of an episode."""


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
    place(simulation, World(0.0, situation.robot, situation.objects))
    drives = Drives(simulation, time_limit)
    episode = drives.run(action, situation, top)
    drives.end()
    return episode


class Drives:
    """Executes actions one after another; one whose goal is passed hands over to the next one.

    `places` are the positions of the robot in the last drive, shape (n, 2), in m.
    """

    def __init__(self, simulation: SimulatedWorld, time_limit: float) -> None:
        self._simulation = simulation
        self._ticks = round(time_limit * CONTROL_RATE)
        self._passed: Action | None = None  # it has passed its goal, and is not ended
        self.places = np.empty((0, 2))

    def run(
        self, action: Action, situation: Situation, top: Top, following: Sequence[Goal] = ()
    ) -> Episode:
        """Execute `action` toward the goal of a situation, until it ends or passes the goal.

        It takes over from an action that has passed its goal. `following` are the goals to which
        the robot drives on then.
        """
        simulation = self._simulation
        start = simulation.time
        worlds: list[World] = []

        def observed(world: World) -> Step:
            worlds.append(world)
            if passes(situation.goal) and not top.unmet(world, situation.goal, simulation.robot):
                self._passed = action
                return Step(None, Status.SUCCEEDED, "passed")
            return action.step(world)

        try:
            self._start(action, situation.goal, following)
            done = run(simulation, observed, ticks=self._ticks)
        except ActionError as error:
            done = Step(STANDING, Status.RUNNING, f"not started: {error}")
        else:
            reason = f"time limit of {self._ticks / CONTROL_RATE:g} s reached"
            done = done or Step(STANDING, Status.RUNNING, reason)
            if self._passed is None:
                action.end(done.message)
        places = [world.robot.pose[:2] for world in worlds]
        self.places = np.array(places).reshape(-1, 2)
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

    def _start(self, action: Action, goal: Goal, following: Sequence[Goal]) -> None:
        action.setup()
        former = self._passed
        try:
            action.start(self._simulation.world(), goal)
            if following:
                action.followed_by(following)
            if former is not None:
                action.take_over(former)
        finally:
            self.end()

    def end(self) -> None:
        """End an action that has passed its goal."""
        if self._passed is not None:
            self._passed.end("passed")
        self._passed = None


def episode_generator(action: str, seed: int, episode: int) -> np.random.Generator:
    """Return the random generator of one episode, which depends only on these three values."""
    key = (zlib.crc32(action.encode()), episode)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _run(
    task: tuple[ActionSpec, list[Key]],
    *,
    tops: tuple[Top, ...],
    robot: Robot,
    objects: tuple[str, ...],
    seed: int,
    time_limit: float,
) -> list[pd.DataFrame]:
    """Run the episodes of a group in a new simulation, and return their rows.

    Each continues where the one before has ended, if that succeeded.
    """
    # Bullet keeps contact caches when bodies are replaced: in a used simulation, episodes with
    # contacts would differ in the sixth digit. A new simulation costs 11 ms.
    spec, keys = task
    numbers = [number for _, number in keys]
    situations = [
        spec.situation(robot, episode_generator(spec.name, seed, number)) for number in numbers
    ]
    for situation in situations:
        if wrong := wrong_values(situation.goal, spec.goal_variables):
            raise ExperienceError(f"situation of {spec.name}: goal: {wrong}")
    goals = _ending_in_a_stop([situation.goal for situation in situations])
    episodes: list[Episode] = []
    with Simulation(robot) as simulation:
        drives = Drives(simulation, time_limit)
        for index, (drawn, goal) in enumerate(zip(situations, goals, strict=True)):
            situation = replace(drawn, goal=goal)
            continues = bool(episodes) and episodes[-1].success
            if continues:
                situation = replace(situation, robot=simulation.world().robot)
            else:
                place(simulation, World(0.0, situation.robot, situation.objects))
            top = top_of(situation, tops, robot)
            following = goals_to_stop(goals[index:])[1:]
            episode = drives.run(spec.factory(robot), situation, top, following)
            if continues and passes(goals[index - 1]):
                episodes[-1] = _passed(episodes[-1], drives.places)
            episodes.append(episode)
        drives.end()
    return [each.rows(number, objects) for each, number in zip(episodes, numbers, strict=True)]


def _ending_in_a_stop(goals: list[Goal]) -> list[Goal]:
    """Return goals the last of which is not passed."""
    *others, last = goals
    return [*others, with_values(last, {STOP: 1.0}) if passes(last) else last]


def _passed(episode: Episode, places: FloatArray) -> Episode:
    """Return the episode of a goal that was passed, with how near the robot has come to it.

    `places` (n, 2) are those of the robot in the next episode, in m.
    """
    distances = np.hypot(*(places - episode.situation.goal.pose[:2]).T)
    nearest = float(distances.min())
    return replace(episode, position_error=nearest, nearer=float(distances[0]) - nearest)


def groups(keys: Iterable[Key], actions: Iterable[ActionSpec]) -> list[list[Key]]:
    """Return the episodes that are driven without a pause: several of an action that can pass.

    Parameters
    ----------
    keys : iterable of Key
        The episodes; those of one group are next to each other.
    actions : iterable of ActionSpec
        Their actions.
    """
    size = {spec.name: _LEGS if STOPS in spec.goal_variables else 1 for spec in actions}
    by_group = itertools.groupby(keys, lambda key: (key[0], key[1] // size[key[0]]))
    return [list(group) for _, group in by_group]


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

    Episodes of an action that can pass follow each other, so that they begin and end in both ways.

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
    by_name = {action.name: action for action in actions}
    keys = itertools.product(by_name, range(episodes))
    tasks = [
        (by_name[group[0][0]], group)
        for group in groups(keys, by_name.values())
        if any(key not in finished for key in group)
    ]
    run_group = partial(
        _run, tops=tuple(tops), robot=robot, objects=objects, seed=seed, time_limit=time_limit
    )
    for frames in run_tasks(run_group, tasks):
        for frame in frames:
            if (frame["action"].iloc[0], int(frame["episode"].iloc[0])) not in finished:
                yield frame
