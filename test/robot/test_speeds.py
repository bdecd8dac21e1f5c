"""Robots from 0.05 to 15 m/s, anywhere on a projected map, at any time."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest
import yaml

from ator_ros.actions.base import Goal, Point, Status
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.robot.description import Limits, Robot, least_torque, load_robot
from ator_ros.robot.response import ramped
from ator_ros.world.state import CONTROL_PERIOD, STOP, RobotState, World

SLOW, FAST = Limits(0.05, 0.4, 0.1, 0.2, 0.8), Limits(15.0, 1.5, 3.0, 4.0, 3.0)


def described(folder: Path, limits: Limits) -> Robot:
    """Write and read the description of a Pioneer with other limits and without a holder."""
    made = load_robot()
    torque = max(made.wheel_torque, least_torque(made.mass, made.wheel_radius, limits))
    made = dataclasses.replace(made, limits=limits, wheel_torque=torque, holder=None)
    file = folder / "robot.yaml"
    file.write_text(yaml.safe_dump(made.sections()))
    return load_robot(file)


@pytest.mark.parametrize(("limits", "way"), [(SLOW, 0.5), (FAST, 120.0)])
@pytest.mark.parametrize(("corner", "time"), [(Pose(0.0, 0.0, 0.0), 0.0), (Pose(5e5, 5.3e6, 2.0), 1.76e9)])
def test_a_robot_drives_to_its_goal(
    tmp_path: Path, limits: Limits, way: float, corner: Pose, time: float
) -> None:
    robot = described(tmp_path, limits)
    library = SOCCER.library(robot)
    action, goal = library.action(library["goToPose"]), corner.compose(Pose(way, 0.3 * way, 1.0))
    pose, command = corner, STOP
    action.start(World(time, RobotState(pose)), Goal(goal, 0.0, Point.AXLE))
    for tick in range(2000):
        step = action.step(World(time + tick * CONTROL_PERIOD, RobotState(pose, command.v, command.w)))
        if step.status is not Status.RUNNING:
            break
        command = ramped(command, step.command, CONTROL_PERIOD, limits, robot.stop)
        half = 0.5 * command.w * CONTROL_PERIOD
        moved = command.v * CONTROL_PERIOD
        pose = pose.compose(Pose(moved * math.cos(half), moved * math.sin(half), 2.0 * half))
    assert step.status is Status.SUCCEEDED, step.message
    assert pose.distance(goal) < 0.06
