"""One execution of an action, observed: the source of all experience (paper, section 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.base import Action, ActionError, Point, Status
from ator_ros.actions.situation import Situation
from ator_ros.geometry import FloatArray, wrap_angle
from ator_ros.robot.ball import ball_of
from ator_ros.robot.description import Robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.world.state import STOP, World

TIME_LIMIT = 30.0  # s, as in the chain executor
TICKS_PER_SAMPLE = 2  # control ticks of 1/20 s, so that samples come at the paper's 10 Hz
HELD = 0.10  # m between ball and hold up to which the ball counts as held
COAST = 6.0  # s that a shot ball may roll after the action has ended
SAMPLE_COLUMNS = ("t", "x", "y", "yaw", "v", "w", "ball_x", "ball_y")
"""What is logged in each sample: s since the start, m, rad, m/s, rad/s; NaN without a ball."""


@dataclass(frozen=True, slots=True)
class Episode:
    """How one execution of an action went.

    Attributes
    ----------
    situation : Situation
        Start and goal.
    samples : ndarray, shape (n, len(SAMPLE_COLUMNS))
        The states at 10 Hz from the start on; those at and after the end are left out.
    duration : float
        From the start to the tick at which the action ended, in s.
    success : bool
        The action ended well, and what it is for has truly come about.
    reason : str
        A sentence on how it ended.
    position_error, heading_error : float
        At the end, between the goal and the point that shall come there, in m and rad; for a shot how
        far the ball ends before the goal's line or beside its mouth, and NaN.
    """

    situation: Situation
    samples: FloatArray
    duration: float
    success: bool
    reason: str
    position_error: float
    heading_error: float


def run_episode(
    simulation: Simulation, action: Action, situation: Situation, *, time_limit: float = TIME_LIMIT
) -> Episode:
    """Execute `action` in `situation`, tick by tick, until it ends or `time_limit` (s) is over.

    Parameters
    ----------
    simulation : Simulation
        A fresh world; robot and ball are placed in it.
    action : Action
        Started here.
    situation : Situation
        Start and goal.
    """
    place(simulation, situation)
    world = simulation.world()
    start = world.time
    samples: list[tuple[float, ...]] = []
    try:
        action.start(world, situation.goal)
    except ActionError as error:
        return _episode(simulation.robot, situation, samples, 0.0, world, f"not started: {error}", False)
    for tick in range(round(time_limit * 20)):
        step = action.step(world)
        if step.status is not Status.RUNNING:
            ended_well = step.status is Status.SUCCEEDED
            duration = world.time - start
            if situation.action == "shoot":
                world = coast(simulation, world)
            return _episode(simulation.robot, situation, samples, duration, world, step.message, ended_well)
        if tick % TICKS_PER_SAMPLE == 0:
            samples.append(_sample(world, start))
        simulation.command(step.command)
        simulation.tick()
        world = simulation.world()
    reason = f"time limit of {time_limit:g} s reached"
    return _episode(simulation.robot, situation, samples, world.time - start, world, reason, False)


def place(simulation: Simulation, situation: Situation) -> None:
    """Put robot and objects where `situation` starts."""
    robot = situation.robot
    simulation.place_robot(robot.pose, v=robot.v, w=robot.w)
    simulation.place_objects(situation.objects)


def coast(simulation: Simulation, world: World) -> World:
    """Let a shot ball roll, with the robot stopping, until it is in the goal, rests, or 6 s are over."""
    for _ in range(round(COAST * 20)):
        ball = ball_of(world)
        if ball is None or ball.speed < 0.02 or _depth(simulation.robot, ball.x, ball.y) > 0.0:
            break
        simulation.command(STOP)
        simulation.tick()
        world = simulation.world()
    return world


def _depth(robot: Robot, x: float, y: float) -> float:
    """Return how far in m a ball at (x, y) is beyond the line of the goal at x > 0; negative: not in it."""
    line, beside = robot.scene.bays[-1].x, abs(y) - robot.scene.bays[-1].width / 2
    return min(x - line, -beside)


def _sample(world: World, start: float) -> tuple[float, ...]:
    pose, ball = world.robot.pose, ball_of(world)
    ball_x, ball_y = (ball.x, ball.y) if ball is not None else (math.nan, math.nan)
    return (world.time - start, *pose, world.robot.v, world.robot.w, ball_x, ball_y)


def _episode(
    robot: Robot,
    situation: Situation,
    samples: list[tuple[float, ...]],
    duration: float,
    world: World,
    message: str,
    ended_well: bool,
) -> Episode:
    """Judge the end of an episode by the true state `world`."""
    goal, pose, ball = situation.goal, world.robot.pose, ball_of(world)
    hold = robot.hold_point(pose)
    if situation.action == "shoot":
        depth = _depth(robot, ball.x, ball.y) if ball is not None else -math.inf
        achieved, fault = depth > 0.0, "the ball is not in the goal"
        position_error, heading_error = max(0.0, -depth), math.nan
    else:
        point = hold if goal.point is Point.HOLD else pose
        achieved = ball is None or math.hypot(ball.x - hold.x, ball.y - hold.y) <= HELD
        fault = "the ball is not held"
        position_error = math.hypot(point.x - goal.pose.x, point.y - goal.pose.y)
        heading_error = abs(wrap_angle(pose.yaw - goal.pose.yaw))
    reason = message if achieved or not ended_well else f"{message}; but {fault}"
    return Episode(
        situation,
        np.asarray(samples, dtype=float).reshape(len(samples), len(SAMPLE_COLUMNS)),
        duration,
        ended_well and achieved,
        reason,
        position_error,
        heading_error,
    )
