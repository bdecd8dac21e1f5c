"""The response of an omnidirectional base to commands."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omni_robots import ROBOTS

from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.bases.omni.planar_response import within_limits
from ator_ros.geometry import Pose
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, RobotState

HERE = Pose(0.5, -1.0, 0.4)
VELOCITIES = st.floats(-9.0, 9.0)
COMMANDS = st.builds(
    lambda vx, vy, w: Command(vx, w, vy=vy), VELOCITIES, VELOCITIES, st.floats(-20.0, 20.0)
)
each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)


@each_robot
@given(command=COMMANDS)
@settings(deadline=None)
def test_a_command_keeps_its_direction_within_the_limits(
    robot: OmniRobot, command: Command
) -> None:
    found = within_limits(command, robot.limits)
    most = robot.limits.speed_towards(math.atan2(command.vy, command.vx))
    assert math.hypot(found.vx, found.vy) <= most + 1e-9
    assert found.vx * command.vy == pytest.approx(found.vy * command.vx, abs=1e-9)
    assert abs(found.w) <= robot.limits.w
    inside = dataclasses.replace(found, vx=0.9 * found.vx, vy=0.9 * found.vy)
    assert within_limits(inside, robot.limits) == inside


@each_robot
@given(command=COMMANDS)
@settings(max_examples=30, deadline=None)
def test_a_base_reaches_a_straight_command_and_stops_within_its_distance(
    robot: OmniRobot, command: Command
) -> None:
    straight = dataclasses.replace(command, w=0.0)
    state = robot.moved(RobotState(HERE), straight, 8.0)
    limited = within_limits(straight, robot.limits)
    assert (state.vx, state.vy) == pytest.approx((limited.vx, limited.vy), abs=1e-6)
    stopped = robot.moved(state, STOP, 8.0)
    assert stopped.speed == pytest.approx(0.0, abs=1e-9)
    distance = stopped.pose.distance(state.pose)
    assert distance <= robot.stopping_distance(state.speed) + 0.01
    stands = robot.standstills(state, 0.0)
    assert stands.commanded == pytest.approx(stopped.pose[:2], abs=0.05)


@each_robot
def test_a_turn_does_not_change_the_velocity_over_the_floor(robot: OmniRobot) -> None:
    state = RobotState(HERE, 0.5, 0.0, vy=0.2)
    heading = HERE.yaw + math.atan2(state.vy, state.vx)
    for _ in range(40):
        relative = heading - state.pose.yaw - 0.5 * state.w * CONTROL_PERIOD
        speed = 0.5
        command = Command(speed * math.cos(relative), 0.8, vy=speed * math.sin(relative))
        state = robot.moved(state, command, CONTROL_PERIOD)
    direction = state.pose.yaw + math.atan2(state.vy, state.vx)
    assert math.remainder(direction - heading, 2.0 * math.pi) == pytest.approx(0.0, abs=0.05)
    assert state.speed == pytest.approx(0.5, abs=0.02)
    assert state.w == pytest.approx(0.8)


@each_robot
def test_velocities_of_starts_are_within_the_limits(robot: OmniRobot) -> None:
    rng = np.random.default_rng(3)
    drawn = [robot.draw_velocity(rng) for _ in range(200)]
    for velocity in drawn:
        most = robot.limits.speed_towards(math.atan2(velocity.vy, velocity.vx))
        assert math.hypot(velocity.vx, velocity.vy) < most
    assert any(velocity.vy > 0.0 for velocity in drawn)
    assert any(velocity.vx < 0.0 for velocity in drawn)
