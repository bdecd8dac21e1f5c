"""Velocities are planar vectors with a turn rate, and former data without a lateral one is read."""

import cmath
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from experience_rows import synthetic_experience
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.bases.description import load_robot
from ator_ros.bases.direct import DIRECT_VARIABLES, direct_table
from ator_ros.experience.table import checked_rows
from ator_ros.geometry import Pose
from ator_ros.tops.conditions import state_of
from ator_ros.world.readers import MessageError, OdometryReader, command_from, world_from
from ator_ros.world.robot_velocity import RobotVelocity
from ator_ros.world.state import Command, RobotState, World

ROBOT = load_robot()
SPEEDS = st.floats(-3.0, 3.0)
HERE = Pose(0.5, -1.0, 0.4)


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return SimpleNamespace(x=x, y=y, z=z)


def situation(**velocities: float) -> Any:
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(0.2), w=math.cos(0.2))
    pose = SimpleNamespace(position=vector(0.5, -1.0), orientation=turn)
    header = SimpleNamespace(frame_id="", stamp=SimpleNamespace(sec=0, nanosec=0))
    return SimpleNamespace(header=header, robot=pose, objects=[], **velocities)


@given(SPEEDS, SPEEDS, SPEEDS)
def test_the_speed_does_not_depend_on_the_direction(vx: float, vy: float, w: float) -> None:
    state = RobotState(HERE, vx, w, vy=vy)
    turned = RobotState(HERE, -vy, w, vy=vx)
    assert state.speed == turned.speed == math.hypot(vx, vy)
    assert state.is_still == turned.is_still
    assert state.velocity == Command(vx, w, vy=vy)


def test_a_robot_that_moves_sideways_does_not_stand() -> None:
    assert not RobotState(HERE, vy=0.1).is_standing
    assert RobotState(HERE, 0.001, vy=-0.001).is_still


def test_conditions_see_all_components() -> None:
    state = state_of(World(0.0, RobotState(HERE, 0.3, -0.2, vy=0.1)), ROBOT)
    assert (state["robot.vx"], state["robot.vy"], state["robot.w"]) == (0.3, 0.1, -0.2)


def test_a_command_has_a_lateral_velocity() -> None:
    twist = SimpleNamespace(linear=vector(0.3, -0.1), angular=vector(z=0.5))
    assert command_from(twist, "cmd_vel") == Command(0.3, 0.5, vy=-0.1)
    flying = SimpleNamespace(linear=vector(0.3, 0.0, 0.1), angular=vector())
    with pytest.raises(MessageError, match=r"linear\.z"):
        command_from(flying, "cmd_vel")


@pytest.mark.parametrize(
    ("velocities", "vy"), [({"v": 0.3, "w": 0.5}, 0.0), ({"vx": 0.3, "vy": 0.1, "w": 0.5}, 0.1)]
)
def test_former_situations_are_read(velocities: dict[str, float], vy: float) -> None:
    robot = world_from(situation(**velocities)).robot
    assert (robot.vx, robot.vy, robot.w) == (0.3, vy, 0.5)


def test_direct_variables_without_a_lateral_velocity_have_none() -> None:
    former = dict.fromkeys(set(DIRECT_VARIABLES) - {"vy"}, np.ones(2))
    table = direct_table(former)
    assert table["vy"].tolist() == [0.0, 0.0]
    assert all((table[name] == 1.0).all() for name in former)
    given = direct_table({**former, "vy": np.array([0.1, 0.2])})
    assert given["vy"].tolist() == [0.1, 0.2]


def test_former_tables_are_read() -> None:
    rows = synthetic_experience("drive_to", episodes=3)
    former = checked_rows("former", rows.drop(columns="vy"), "default")
    pd.testing.assert_frame_equal(former, checked_rows("now", rows, "default"))
    assert (former["vy"] == 0.0).all()


def odometry(*, child: str) -> Any:
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(0.2), w=math.cos(0.2))
    pose = SimpleNamespace(position=vector(0.5, -1.0), orientation=turn)
    twist = SimpleNamespace(linear=vector(0.3, 0.1), angular=vector(z=0.5))
    header = SimpleNamespace(frame_id="odom", stamp=SimpleNamespace(sec=1, nanosec=0))
    return SimpleNamespace(
        header=header,
        child_frame_id=child,
        pose=SimpleNamespace(pose=pose),
        twist=SimpleNamespace(twist=twist),
    )


@pytest.mark.parametrize("child", ["base_link", "odom"])
def test_lateral_velocities_are_read_of_bases_that_have_them(child: str) -> None:
    _, plain = OdometryReader("odom").read(odometry(child=child))
    _, robot = OdometryReader("odom", sideways=True).read(odometry(child=child))
    assert (plain.vx, plain.vy, plain.w) == (robot.vx, 0.0, robot.w)
    own = complex(0.3, 0.1) * (cmath.rect(1.0, -0.4) if child == "odom" else 1.0)
    assert complex(robot.vx, robot.vy) == pytest.approx(own)


@pytest.mark.parametrize("sideways", [False, True])
def test_lateral_velocities_are_estimated_of_bases_that_have_them(sideways: bool) -> None:
    estimate = RobotVelocity(1.0, 2.0, sideways=sideways)
    for tick in range(5):
        state = estimate.state(0.02 * tick, Pose(0.0, 0.01 * tick, 0.0))
    assert (state.vx, state.vy) == pytest.approx((0.0, 0.5 if sideways else 0.0))
