"""The named state variables that conditions speak of (paper, section 4.1)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from ator_ros.actions.base import Goal
from ator_ros.robot.description import Robot
from ator_ros.world.state import RobotState, World

State = Mapping[str, float]


def state_of(world: World, robot: Robot) -> dict[str, float]:
    """Return the state variables of a world.

    Returns
    -------
    dict
        robot.x, robot.y (m), robot.yaw (rad), robot.v (m/s), robot.w (rad/s); hold.x, hold.y (m), where
        a robot with a holder would hold an object; of each known object, with its name before the dot, x,
        y (m), vx, vy (m/s).
    """
    pose = world.robot.pose
    state = {
        "robot.x": pose.x,
        "robot.y": pose.y,
        "robot.yaw": pose.yaw,
        "robot.v": world.robot.v,
        "robot.w": world.robot.w,
    }
    if robot.holder is not None:
        hold = robot.hold_point(pose)
        state |= {"hold.x": hold.x, "hold.y": hold.y}
    for name, there in world.objects.items():
        state |= {f"{name}.{axis}": getattr(there, axis) for axis in ("x", "y", "vx", "vy")}
    return state


def arrived(world: World, goal: Goal, robot: Robot) -> World:
    """Return the world when the robot has arrived at `goal` and nothing else has changed."""
    return dataclasses.replace(world, robot=RobotState(goal.robot_pose(robot), goal.speed, 0.0))
