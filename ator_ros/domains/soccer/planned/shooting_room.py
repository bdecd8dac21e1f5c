"""Sample shots for which the planner finds a run-up."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from ator_ros.actions.base import ActionError, Status, started
from ator_ros.actions.situation import Situation, drawn_until
from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.field import objects_of, touches_goals
from ator_ros.domains.soccer.planned.shoot import Shoot
from ator_ros.robot.description import Robot
from ator_ros.world.state import CONTROL_PERIOD, ObjectState, RobotState, World

T = TypeVar("T")

_DRAWS = 200
"""Draws after which no run-up is expected any more: each is planned, which takes some 15 ms."""
_SEEN = 0.05  # m between the poses at which a braking robot is looked at


def shoot(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a shot that has room for a run-up.

    Raises
    ------
    ConfigError
        The robot is too large for the goal, or has no holder.
    """
    return with_room(robot, lambda: situations.shoot(robot, rng), lambda situation: situation)


def with_room(robot: Robot, draw: Callable[[], T], shot: Callable[[T], Situation]) -> T:
    """Draw until the shot that is part of what is drawn has room for a run-up; NoPlaceError if none has."""
    return drawn_until(
        draw,
        lambda drawn: has_room(robot, shot(drawn)),
        lambda: (
            f"shoot: expected room for a run-up to the goal, robot {robot.name} reaches "
            f"{robot.reach:.2f} m from its axle"
        ),
        most=_DRAWS,
    )


def has_room(robot: Robot, situation: Situation) -> bool:
    """Return whether a run-up is found: at once, or where a robot in motion stands after braking."""
    action, world = Shoot(robot), World(0.0, situation.robot, situation.objects)
    try:
        with started(action, world, situation.goal, "looked for room"):
            return _finds_run_up(action, situation.robot)
    except ActionError:
        return False


def _finds_run_up(action: Shoot, start: RobotState) -> bool:
    """Return whether an action that has started at `start` finds its way."""
    robot = action.robot
    brakes = start.v * (start.v / (2.0 * action.plan_limits.brake) + robot.motor_time_constant)
    way = np.array([start.pose.ahead(at) for at in np.arange(0.0, brakes, _SEEN)])
    if action.planning and len(way) and touches_goals(way, robot):
        return False
    pose = start.pose.ahead(brakes)
    held = robot.hold_point(pose)
    there, ticks = objects_of(ObjectState(held.x, held.y)), 0
    while action.planning:
        ticks += 1
        step = action.step(World(ticks * CONTROL_PERIOD, RobotState(pose), there))
        if step.status is not Status.RUNNING:  # where the ball rolls in first, no plan is ever made
            return step.status is Status.SUCCEEDED
    return True
