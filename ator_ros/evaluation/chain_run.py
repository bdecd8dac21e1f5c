"""Execution of a chain in the simulator, with the chain executor that the node uses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Status
from ator_ros.actions.goal_variables import goal_values
from ator_ros.execution.chain_executor import ActionRecord, ChainExecutor, ChainStep, Ending
from ator_ros.execution.rolling import Rolling
from ator_ros.geometry import wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.robot.response import Foresight
from ator_ros.simulation.run import judge, place, run
from ator_ros.simulation.simulation import CONTROL_RATE, Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World

TICKS_PER_POINT = 2  # of the path, at 10 Hz


@dataclass(frozen=True, slots=True)
class ChainRun:
    """The result of one execution of a chain.

    Attributes
    ----------
    duration : float
        In s; the time limit if the chain failed.
    success : bool
        Whether every action succeeded and the last TOP's post-condition truly holds; with simulated sensors
        only its terms about objects count.
    reason : str
        How it ended, in a sentence.
    actions : tuple of float
        Durations in s of the actions that ended.
    error : float
        Final distance in m from the last goal, of the axle or the hold; NaN if the last TOP does not place
        the robot.
    path : tuple of (x, y, object x, object y)
        Positions in m of the robot and of the first object, at 10 Hz; NaN without an object; empty
        unless asked for.
    """

    duration: float
    success: bool
    reason: str
    actions: tuple[float, ...]
    error: float
    path: tuple[tuple[float, float, float, float], ...] = ()


ChainKey = tuple[object, ...]


def key_of(chain: TopChain) -> ChainKey:
    """Return a key of chains from the same start: TOPs, and goal variables to 1e-6 (m, rad, m/s)."""
    return tuple(
        part
        for call in chain.calls
        for part in (call.top.name, *(_rounded(*item) for item in goal_values(call.goal).items()))
    )


def _rounded(name: str, value: float) -> float:
    return round(wrap_angle(value) if name == "yaw" else value, 6) + 0.0  # not -0.0


def run_chain(
    robot: Robot,
    library: TopLibrary,
    start: World,
    chain: TopChain,
    *,
    keep_path: bool = False,
    observe: Callable[[World], World] | None = None,
    fetches: int = 0,
    latency: float = 0.0,
    time_limit: float = TIME_LIMIT,
    wheels: tuple[float, float] = (1.0, 1.0),
    records: list[ActionRecord] | None = None,
    executor: ChainExecutor | None = None,
    rolling: Rolling | None = None,
) -> ChainRun:
    """Execute `chain` from `start` in a new simulation.

    Parameters
    ----------
    robot : Robot
        Shape, limits and scene.
    library : TopLibrary
        TOPs and actions.
    start : World
        Robot and objects at the start.
    chain : TopChain
        The chain to execute.
    keep_path : bool
        Whether to log the path.
    observe : callable, optional
        Returns the state that the executor observes, once per tick; by default the true state.
    fetches : int
        Number of times that a lost object may be fetched again.
    latency : float
        Time in s by which observed states are predicted forward, see `Foresight`.
    time_limit : float
        Time in s that the chain may take, and so each of its actions.
    wheels : (float, float)
        See `Simulation`.
    records : list, optional
        Gets the records of the actions that ended.
    executor : ChainExecutor, optional
        Executes the chain; by default a new one with these settings.
    rolling : Rolling, optional
        Estimate of how objects roll, which is updated; by default a new one.
    """
    rolling = rolling if rolling is not None else Rolling(library.robot)
    if executor is None:
        executor = ChainExecutor(library, chain, time_limit=time_limit, fetches=fetches, rolling=rolling)
    steered = _steering(executor, Foresight(robot, latency), rolling)
    worlds: list[World] = []
    with Simulation(robot, wheels=wheels) as simulation:
        place(simulation, start)
        ticks, message = round(time_limit * CONTROL_RATE) + 1, "broken off"
        try:
            done = run(simulation, steered, ticks=ticks, watch=worlds.append, observe=observe)
            status = Status.RUNNING if done is None else done.status
            message = f"not done after {time_limit:g} s" if done is None else done.message
            ended, ended_actions, last = simulation.time, tuple(executor.records), chain.calls[-1]
        finally:  # an error must not leave the action under way without its end
            executor.break_off(simulation.world(), Ending.CANCELED, message)
        judgement = judge(simulation, last.top, last.goal, status, message, drifts=observe is not None)
    if records is not None:
        records += ended_actions
    return ChainRun(
        ended if judgement.success else time_limit,
        judgement.success,
        judgement.reason,
        tuple(record.duration for record in ended_actions),
        judgement.error if last.top.arrives else math.nan,
        tuple(_place(world) for world in worlds[::TICKS_PER_POINT]) if keep_path else (),
    )


def _steering(
    executor: ChainExecutor, foresight: Foresight, rolling: Rolling
) -> Callable[[World], ChainStep]:
    """Return a function that executes a tick of the chain for an observed state."""

    def steered(observed: World) -> ChainStep:
        world = foresight.ahead(observed)
        rolling.observe(world)
        step = executor.step(world)
        if step.status is Status.RUNNING:
            foresight.sent(observed.time, step.command)
        return step

    return steered


def _place(world: World) -> tuple[float, float, float, float]:
    pose, first = world.robot.pose, next(iter(world.objects.values()), None)
    return pose.x, pose.y, *((math.nan, math.nan) if first is None else (first.x, first.y))
