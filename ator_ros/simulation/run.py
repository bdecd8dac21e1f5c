"""Simulated runs: everything that executes something in the simulator goes through here."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from ator_ros.actions import TIME_LIMIT
from ator_ros.actions.base import Action, Goal, Point, Status, Step
from ator_ros.geometry import wrap_angle
from ator_ros.simulation.simulation import CONTROL_RATE, Simulation
from ator_ros.tops.chain import Top
from ator_ros.world.state import STOP, World


def place(simulation: Simulation, world: World) -> None:
    """Put the robot and the objects of `world` into the simulation, those without a size excepted."""
    robot = world.robot
    simulation.place_robot(robot.pose, v=robot.v, w=robot.w)
    known = simulation.robot.scene.objects
    simulation.place_objects({name: there for name, there in world.objects.items() if name in known})


def run(simulation: Simulation, step: Callable[[World], Step], *, ticks: int) -> Step | None:
    """Steer the robot tick by tick until `step` ends; everything has been placed in the simulation.

    Parameters
    ----------
    step : callable
        Returns what to do in a state.
    ticks : int
        Greatest number of control ticks.

    Return the last step, which is not running; None if `ticks` are over before.
    """
    for _ in range(ticks):
        done = step(simulation.world())
        if done.status is not Status.RUNNING:
            return done
        if done.command is not None:
            simulation.command(done.command)
        simulation.tick()
    return None


def settle(simulation: Simulation, top: Top, goal: Goal) -> World:
    """Let objects move on, with the robot stopping, as long as `top` allows; return the true state then.

    It ends as soon as the post-condition holds or all its objects rest.
    """
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
        Its action succeeded, and its post-condition holds.
    reason : str
        A sentence on how it ended.
    error : float
        Distance of the robot's point from the goal in m where the TOP places it there; else how far the world
        is from the post-condition, in the unit of the worst variable.
    heading_error : float
        Difference of headings in rad; NaN where the TOP does not place the robot.
    """

    success: bool
    reason: str
    error: float
    heading_error: float


def judge(simulation: Simulation, top: Top, goal: Goal, status: Status, message: str) -> Judgment:
    """Judge a TOP by its post-condition, which alone decides whether an action that succeeded has done so.

    `status` and `message` are how the action ended: RUNNING if it was broken off; then nothing settles.
    """
    robot, ended_well = simulation.robot, status is Status.SUCCEEDED
    world = simulation.world() if status is Status.RUNNING else settle(simulation, top, goal)
    lacks = top.unmet(world, goal, robot)
    reason = f"{message}; but {top.failure(lacks)}" if lacks and ended_well else message
    error, heading_error = top.shortfall(world, goal, robot), math.nan
    if top.arrives:
        pose = world.robot.pose
        point = robot.hold_point(pose) if goal.point is Point.HOLD else pose
        error = math.hypot(point.x - goal.pose.x, point.y - goal.pose.y)
        heading_error = abs(wrap_angle(pose.yaw - goal.pose.yaw))
    return Judgment(ended_well and not lacks, reason, error, heading_error)


def run_action(
    simulation: Simulation,
    action: Action,
    goal: Goal,
    *,
    time_limit: float = TIME_LIMIT,
    step: Callable[[Action, World], Step] | None = None,
) -> Step:
    """Execute one action from here until it ends; return its last step, RUNNING at the time limit.

    Parameters
    ----------
    simulation : Simulation
        The world, in which everything has been placed.
    action : Action
        Set up and started here, and ended whatever happens.
    time_limit : float
        Time in s that it may take.
    step : callable, optional
        Called in each tick instead of `Action.step`, to observe it.

    Raises
    ------
    ActionError
        The action cannot start.
    """
    action.setup()
    action.start(simulation.world(), goal)
    reason = "broken off"
    try:
        stepped = action.step if step is None else partial(step, action)
        done = run(simulation, stepped, ticks=round(time_limit * CONTROL_RATE))
        reason = f"time limit of {time_limit:g} s reached" if done is None else done.message
    finally:
        action.end(reason)
    return done or Step(STOP, Status.RUNNING, reason)
