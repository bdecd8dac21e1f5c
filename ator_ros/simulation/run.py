"""Runs in the simulator: the tick loop, and the judgment of how a TOP ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, Goal, Point, Status, Step
from ator_ros.actions.goal_variables import passes
from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.simulation.scene_simulation import CONTROL_RATE
from ator_ros.tops.chain import Top
from ator_ros.world.state import STOP, Command, ObjectState, World


class SimulatedWorld(Protocol):
    """What runs need of a simulation of one robot; see `Simulation`."""

    @property
    def robot(self) -> Robot:
        """The robot and its scene."""

    @property
    def time(self) -> float:
        """Simulated time in s."""

    def world(self) -> World:
        """Return the true state."""

    def place_robot(self, pose: Pose, velocity: Command = ...) -> None:
        """Put the robot at `pose`, moving at `velocity`."""

    def place_objects(self, objects: Mapping[str, ObjectState]) -> None:
        """Place these objects and take all others away."""

    def command(self, command: Command) -> None:
        """Send the robot a velocity command."""

    def tick(self) -> None:
        """Advance the world by one control tick."""


def place(simulation: SimulatedWorld, world: World) -> None:
    """Put the robot and the objects of `world` that have a size into the simulation."""
    simulation.place_robot(world.robot.pose, world.robot.velocity)
    known = simulation.robot.scene.objects
    simulation.place_objects(
        {name: there for name, there in world.objects.items() if name in known}
    )


def run(
    simulation: SimulatedWorld,
    step: Callable[[World], Step],
    *,
    ticks: int,
) -> Step | None:
    """Execute the steps that `step` returns until one is not RUNNING.

    Parameters
    ----------
    simulation : SimulatedWorld
        The world.
    step : callable
        Returns the next step in a state of the world.
    ticks : int
        Greatest number of control ticks.

    Returns
    -------
    Step or None
        The last step; None after `ticks`.
    """
    for _ in range(ticks):
        done = step(simulation.world())
        if done.status is not Status.RUNNING:
            return done
        if done.command is not None:
            simulation.command(done.command)
        simulation.tick()
    return None


def _settle(simulation: SimulatedWorld, top: Top, goal: Goal) -> World:
    """Stop until the post-condition holds, its objects rest or `top.settles` is over."""
    world = simulation.world()
    for _ in range(round(top.settles * CONTROL_RATE)):
        if not top.may_settle(world) or not top.unmet(world, goal, simulation.robot):
            break
        simulation.command(STOP)
        simulation.tick()
        world = simulation.world()
    return world


@dataclass(frozen=True, slots=True)
class Judgment:
    """How a TOP ended, by the true state.

    Attributes
    ----------
    success : bool
        Whether the action succeeded and the post-condition holds.
    reason : str
        How it ended, in a sentence.
    error : float
        Distance in m of the robot's point from the goal if the TOP places it there; else the
        greatest violation of the post-condition, in the unit of the variable.
    heading_error : float
        Error of the heading in rad; NaN if the TOP does not place the robot, or it passes.
    """

    success: bool
    reason: str
    error: float
    heading_error: float


def judge(
    simulation: SimulatedWorld,
    top: Top,
    goal: Goal,
    status: Status,
    message: str,
) -> Judgment:
    """Judge a TOP by its post-condition, after objects have settled.

    Parameters
    ----------
    simulation : SimulatedWorld
        The world after the action.
    top : Top
        The TOP.
    goal : Goal
        Its goal.
    status, message : Status and str
        Those of the last step of the action. After RUNNING, nothing settles.
    """
    robot = simulation.robot
    ended_well = status is Status.SUCCEEDED
    world = simulation.world() if status is Status.RUNNING else _settle(simulation, top, goal)
    lacks = top.unmet(world, goal, robot)
    reason = f"{message}; but {top.failure(lacks)}" if lacks and ended_well else message
    error = top.shortfall(world, goal, robot)
    heading_error = math.nan
    if top.arrives:
        pose = world.robot.pose
        point = robot.hold_point(pose) if goal.point is Point.HOLD else pose
        error = math.hypot(point.x - goal.pose.x, point.y - goal.pose.y)
        if not passes(goal):
            heading_error = abs(wrap_angle(pose.yaw - goal.pose.yaw))
    return Judgment(ended_well and not lacks, reason, error, heading_error)


def run_action(
    simulation: SimulatedWorld,
    action: Action,
    goal: Goal,
    *,
    time_limit: float = TIME_LIMIT,
    step: Callable[[Action, World], Step] | None = None,
) -> Step:
    """Set up, start, step and end an action.

    Parameters
    ----------
    simulation : SimulatedWorld
        The world.
    action : Action
        The action.
    goal : Goal
        Its goal.
    time_limit : float
        Greatest duration in s.
    step : callable, optional
        Called in each tick instead of `Action.step`, to observe it.

    Returns
    -------
    Step
        The last step; it is RUNNING if the time limit was reached.

    Raises
    ------
    ActionError
        The action cannot start.
    """
    action.setup()
    action.start(simulation.world(), goal)
    reason = "interrupted"
    try:
        stepped = action.step if step is None else partial(step, action)
        done = run(simulation, stepped, ticks=round(time_limit * CONTROL_RATE))
        reason = f"time limit of {time_limit:g} s reached" if done is None else done.message
    finally:
        action.end(reason)
    return done or Step(STOP, Status.RUNNING, reason)
