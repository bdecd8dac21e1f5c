"""An episode: one observed execution of an action (paper, section 3)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, ActionError, Status, Step
from ator_ros.actions.situation import Situation
from ator_ros.bases.drive_parts import DriveParts
from ator_ros.geometry import FloatArray
from ator_ros.simulation.run import SimulatedWorld, judge, place, run_action
from ator_ros.tops.chain import Top
from ator_ros.world.state import STOP, World

TICKS_PER_SAMPLE = 2  # of 1/20 s: the paper's 10 Hz


@dataclass(frozen=True, slots=True)
class Episode:
    """One observed execution of an action.

    Attributes
    ----------
    situation : Situation
        Start and goal.
    samples : ndarray, shape (n, k)
        The states at 10 Hz from the start until before the end, at least the start. The columns are
        STATE_COLUMNS, then x, y in m of each object, NaN where unknown.
    duration : float
        From the start to the tick at which the action ended, in s.
    success : bool
        The action ended well, and the TOP's post-condition truly holds.
    reason : str
        How it ended, in a sentence.
    position_error, heading_error : float
        Distance in m and angle in rad to the goal at the end, of the axle or the hold. If the TOP
        does not place the robot: how far the world is from the post-condition, and NaN.
    objects : tuple of str
        The objects in `samples`.
    parts : DriveParts or None
        By odometry; None: computed from `samples`.
    """

    situation: Situation
    samples: FloatArray
    duration: float
    success: bool
    reason: str
    position_error: float
    heading_error: float
    objects: tuple[str, ...] = ()
    parts: DriveParts | None = None


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
    start, worlds = simulation.time, list[World]()

    def observed(action: Action, world: World) -> Step:
        worlds.append(world)
        return action.step(world)

    try:
        done = run_action(simulation, action, situation.goal, time_limit=time_limit, step=observed)
    except ActionError as error:
        done = Step(STOP, Status.RUNNING, f"not started: {error}")
    duration = simulation.time - start
    judgment = judge(simulation, top, situation.goal, done.status, done.message)
    names = tuple(situation.objects)
    rows = [sample_of(world, start, names) for world in worlds[::TICKS_PER_SAMPLE]]
    samples = [row for row in rows if row[0] < duration] or [sample_of(initial, 0.0, names)]
    result = (judgment.success, judgment.reason, judgment.error, judgment.heading_error)
    return Episode(situation, np.array(samples, dtype=float), duration, *result, names)


def sample_of(world: World, start: float, objects: Iterable[str]) -> tuple[float, ...]:
    """Return a row of `Episode.samples`: the state `world` of an episode that started at `start` (s)."""
    found = (world.objects.get(name) for name in objects)
    places = ((math.nan, math.nan) if there is None else (there.x, there.y) for there in found)
    robot = world.robot
    return (
        world.time - start,
        *robot.pose,
        robot.vx,
        robot.w,
        robot.vy,
        *itertools.chain.from_iterable(places),
    )
