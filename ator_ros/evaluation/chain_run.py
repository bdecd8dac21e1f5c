"""Executing a chain in the simulator, tick by tick, with the executor that the node uses."""

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
from ator_ros.simulation.pioneer import CONTROL_RATE, PioneerSimulation
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World

TIME_LIMIT = 30.0
"""Time in s that a chain may take; a failed chain counts as if it had taken that long."""


@dataclass(frozen=True, slots=True)
class ChainRun:
    """How one execution of a chain went.

    Attributes
    ----------
    duration : float
        In s; `TIME_LIMIT` for a chain that failed.
    success : bool
        Every action ended well, and the ball is where the plan wanted it.
    reason : str
        A sentence on how it ended.
    actions : tuple of float
        Durations of the actions in s, as far as it came.
    error : float
        Distance in m between the last goal and what should have come there; NaN for a shot.
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
    """Execute `chain` from `start` in a world of its own.

    Parameters
    ----------
    robot : Robot
        Shape, limits, ball and field.
    library : TopLibrary
        Gives the actions.
    start : World
        Robot and ball at the start.
    chain : TopChain
        What to execute.
    keep_path : bool
        Also log where robot and ball were.
    observe : callable, optional
        What the executor is told of the state, once a tick; by default the truth.
    fetches : int
        How many times a lost ball may be fetched again.
    latency : float
        By how much in s the executor looks ahead of what it observes, see `Foresight`.
    """
    foresight = Foresight(robot, latency)
    path: list[tuple[float, float, float, float]] = []
    last = math.nan
    executor = ChainExecutor(library, chain, time_limit=TIME_LIMIT, fetches=fetches)
    with PioneerSimulation(robot) as simulation:
        simulation.place_robot(start.robot.pose, v=start.robot.v, w=start.robot.w)
        placed = ball_of(start)
        if placed is not None:
            simulation.place_ball(placed.x, placed.y, vx=placed.vx, vy=placed.vy)
        for tick in range(round(TIME_LIMIT * CONTROL_RATE) + 1):
            world = simulation.world()
            ball = ball_of(world)
            if keep_path and tick % 2 == 0:
                place = (math.nan, math.nan) if ball is None else (ball.x, ball.y)
                path.append((world.robot.pose.x, world.robot.pose.y, *place))
            seen = world if observe is None else observe(world)
            if seen.time == last:  # no word of anything newer yet
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
    simulation: PioneerSimulation,
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


def _outcome(simulation: PioneerSimulation, chain: TopChain, world: World) -> tuple[bool, str, float]:
    """Return whether the chain has done what it is for, what is wrong otherwise, and the final error in m."""
    robot, last = simulation.robot, chain.calls[-1]
    if last.top.action == "shoot":
        ball = ball_of(coast(simulation, world))
        line, _ = robot.field.goal_centre()
        scored = ball is not None and ball.x > line and abs(ball.y) < robot.field.goal_width / 2
        return scored, "the ball is not in the goal", math.nan
    pose, ball = world.robot.pose, ball_of(world)
    hold = robot.hold_point(pose)
    point = hold if last.goal.point is Point.HOLD else pose
    held = ball is not None and math.hypot(ball.x - hold.x, ball.y - hold.y) <= HELD
    achieved = held or last.goal.point is Point.AXLE
    return achieved, "the ball is not held at the end", point.distance(last.goal.pose)
