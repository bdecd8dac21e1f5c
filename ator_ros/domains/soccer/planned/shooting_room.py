"""Sample shots for which the planner finds a run-up."""

from __future__ import annotations

import numpy as np

from ator_ros.actions.base import ActionError, Status
from ator_ros.actions.situation import Situation
from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.ball import objects_of
from ator_ros.domains.soccer.goals import touches_goals
from ator_ros.domains.soccer.planned.shoot import Shoot
from ator_ros.robot.description import ConfigError, Robot
from ator_ros.world.state import CONTROL_PERIOD, ObjectState, RobotState, World

_DRAWS = 200
_SEEN = 0.05  # m between the poses at which a braking robot is looked at


def shoot(robot: Robot, rng: np.random.Generator) -> Situation:
    """Draw a shot that has room for a run-up.

    Raises
    ------
    ConfigError
        The robot is too large for the goal, or has no holder.
    """
    for _ in range(_DRAWS):
        situation = situations.shoot(robot, rng)
        if has_room(robot, situation):
            return situation
    raise ConfigError(
        f"shoot: expected room for a run-up to the goal, found none from {_DRAWS} places: "
        f"robot {robot.name} reaches {robot.reach:.2f} m from its axle"
    )


def has_room(robot: Robot, situation: Situation) -> bool:
    """Return whether a run-up is found: at once, or where a robot in motion stands after braking."""
    action, start = Shoot(robot), situation.robot
    try:
        action.start(World(0.0, start, situation.objects), situation.goal)
    except ActionError:
        return False
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
        if step.status is Status.FAILED:
            return False
    return True
