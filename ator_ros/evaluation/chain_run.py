"""Execution of a chain in the simulator, with the chain executor of the node."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Status, Step
from ator_ros.bases.description import Robot
from ator_ros.execution.chain_executor import ChainExecutor, Ending
from ator_ros.execution.rolling import Rolling
from ator_ros.refinement.chain_prediction import PredictsPerformance
from ator_ros.simulation.run import judge, place, run
from ator_ros.simulation.scene_simulation import CONTROL_RATE, Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World


@dataclass(frozen=True, slots=True)
class ChainRun:
    """The result of one execution of a chain.

    Attributes
    ----------
    duration : float
        Duration in s; the time limit if the chain failed.
    success : bool
        Whether every action succeeded, and the last TOP's post-condition holds in the simulator.
    reason : str
        How the chain ended, in a sentence.
    actions : tuple of float
        Durations in s of the actions that ended.
    error : float
        Final distance in m from the last goal, of the axle or the hold; NaN if the last TOP does
        not place the robot.
    """

    duration: float
    success: bool
    reason: str
    actions: tuple[float, ...]
    error: float


def run_chain(
    robot: Robot,
    library: TopLibrary,
    start: World,
    chain: TopChain,
    *,
    time_limit: float = TIME_LIMIT,
    models: Mapping[str, PredictsPerformance] = MappingProxyType({}),
    executor: ChainExecutor | None = None,
) -> ChainRun:
    """Execute a chain in a new simulation.

    Parameters
    ----------
    robot : Robot
        The robot, with its scene.
    library : TopLibrary
        TOPs and their actions.
    start : World
        State at the start.
    chain : TopChain
        The chain.
    time_limit : float
        Greatest duration in s.
    models : mapping, optional
        See `ChainExecutor`.
    executor : ChainExecutor, optional
        Executes the chain; by default a new one.
    """
    rolling = Rolling(library.robot)
    if executor is None:
        executor = ChainExecutor(
            library, chain, time_limit=time_limit, rolling=rolling, models=models
        )

    def steered(world: World) -> Step:
        rolling.observe(world)
        return executor.step(world)

    with Simulation(robot) as simulation:
        place(simulation, start)
        ticks = round(time_limit * CONTROL_RATE) + 1
        message = "interrupted"
        try:
            done = run(simulation, steered, ticks=ticks)
            status = Status.RUNNING if done is None else done.status
            message = f"not done after {time_limit:g} s" if done is None else done.message
            end_time = simulation.time
            records = tuple(executor.records)
            last = chain.calls[-1]
        finally:  # also after an error, the action must be ended
            executor.interrupt(simulation.world(), Ending.CANCELED, message)
        judgment = judge(simulation, last.top, last.goal, status, message)
    duration = end_time if judgment.success else time_limit
    actions = tuple(record.duration for record in records)
    error = judgment.error if last.top.arrives else math.nan
    return ChainRun(duration, judgment.success, judgment.reason, actions, error)
