"""Execution of a chain in the simulator, with the chain executor that the node uses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ator_ros.actions.base import Point, Status
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.experience.episode import HELD, coast
from ator_ros.robot.ball import ball_of
from ator_ros.robot.description import Robot
from ator_ros.robot.foresight import Foresight
from ator_ros.simulation.simulation import CONTROL_RATE, Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World

TIME_LIMIT = 30.0
"""Time limit of a chain in s, which is also the duration of a failed chain."""


@dataclass(frozen=True, slots=True)
class ChainRun:
    """The result of one execution of a chain.

    Attributes
    ----------
    duration : float
        In s; `TIME_LIMIT` if the chain failed.
    success : bool
        Whether every action succeeded and, by the true state, the ball is held or in the goal as planned.
    reason : str
        A sentence on how it ended.
    actions : tuple of float
        Durations in s of the actions that ended.
    error : float
        Final distance in m from the last goal, of the axle or the hold; NaN for a shot.
    path : tuple of (x, y, ball x, ball y)
        In m at 10 Hz, NaN without a ball; empty unless asked for.
    """

    duration: float
    success: bool
    reason: str
    actions: tuple[float, ...]
    error: float
    path: tuple[tuple[float, float, float, float], ...] = ()


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
) -> ChainRun:
    """Execute `chain` from `start` in a new simulation.

    Parameters
    ----------
    robot : Robot
        Shape, limits, ball and field.
    library : TopLibrary
        TOPs and actions.
    start : World
        Robot and ball at the start.
    chain : TopChain
        The chain to execute.
    keep_path : bool
        Whether to log the positions of robot and ball.
    observe : callable, optional
        Returns the state that the executor observes, once per tick; by default the true state.
    fetches : int
        Number of times that a lost object may be fetched again.
    latency : float
        Time in s by which observed states are predicted forward, see `Foresight`.
    """
    foresight = Foresight(robot, latency)
    path: list[tuple[float, float, float, float]] = []
    last = math.nan
    executor = ChainExecutor(library, chain, time_limit=TIME_LIMIT, fetches=fetches)
    with Simulation(robot) as simulation:
        simulation.place_robot(start.robot.pose, v=start.robot.v, w=start.robot.w)
        simulation.place_objects(start.objects)
        for tick in range(round(TIME_LIMIT * CONTROL_RATE) + 1):
            world = simulation.world()
            ball = ball_of(world)
            if keep_path and tick % 2 == 0:
                place = (math.nan, math.nan) if ball is None else (ball.x, ball.y)
                path.append((world.robot.pose.x, world.robot.pose.y, *place))
            seen = world if observe is None else observe(world)
            if seen.time == last:  # nothing newer was observed
                simulation.tick()
                continue
            last = seen.time
            step = executor.step(foresight.ahead(seen))
            if step.status is not Status.RUNNING:
                return _judge(simulation, executor, chain, step.status, step.message, tuple(path))
            foresight.sent(seen.time, step.command)
            simulation.command(step.command)
            simulation.tick()
        return _judge(
            simulation, executor, chain, Status.FAILED, f"not done after {TIME_LIMIT:g} s", tuple(path)
        )


def _judge(
    simulation: Simulation,
    executor: ChainExecutor,
    chain: TopChain,
    status: Status,
    message: str,
    path: tuple[tuple[float, float, float, float], ...],
) -> ChainRun:
    actions = tuple(record.duration for record in executor.records)
    world = simulation.world()
    achieved, fault, error = _outcome(simulation, chain, world)
    if status is Status.SUCCEEDED and achieved:
        return ChainRun(world.time, True, message, actions, error, path)
    reason = message if status is not Status.SUCCEEDED else fault
    return ChainRun(TIME_LIMIT, False, reason, actions, error, path)


def _outcome(simulation: Simulation, chain: TopChain, world: World) -> tuple[bool, str, float]:
    """Return whether the chain achieved its purpose, a sentence for the case that not, and the error in m."""
    robot, last = simulation.robot, chain.calls[-1]
    if last.top.action == "shoot":
        ball = ball_of(coast(simulation, world))
        goal = robot.scene.bays[-1]
        scored = ball is not None and ball.x > goal.x and abs(ball.y) < goal.width / 2
        return scored, "the ball is not in the goal", math.nan
    pose, ball = world.robot.pose, ball_of(world)
    hold = robot.hold_point(pose)
    point = hold if last.goal.point is Point.HOLD else pose
    held = ball is not None and math.hypot(ball.x - hold.x, ball.y - hold.y) <= HELD
    achieved = held or last.goal.point is Point.AXLE
    return achieved, "the ball is not held at the end", point.distance(last.goal.pose)
