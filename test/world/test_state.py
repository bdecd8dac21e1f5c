"""States of robot and objects, and levels of standstill."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.geometry import Pose
from ator_ros.world.state import (
    AT_REST,
    RESTING,
    STANDING,
    STILL,
    Command,
    ObjectState,
    RobotState,
    Standstill,
    World,
)

SPEED = st.floats(-3.0, 3.0)


@given(SPEED, SPEED)
def test_a_standstill_is_one_of_both_speeds_of_any_sign(v: float, w: float) -> None:
    level = Standstill(0.5, 1.0)
    assert level.holds(v, w) == (abs(v) <= 0.5 and abs(w) <= 1.0)
    assert level.holds(-v, -w) == level.holds(v, w)
    assert Standstill(0.5).holds(v, w) == (abs(v) <= 0.5)


def test_a_standstill_is_tested_elementwise_up_to_its_bounds() -> None:
    level = Standstill(0.5, 1.0)
    v = np.array([0.5, 0.6, 0.0, 0.0])
    w = np.array([1.0, 0.0, 1.1, 0.0])
    assert level.holds(v, w).tolist() == [True, False, False, True]
    assert level.holds(np.array([0.5, 0.6])).tolist() == [True, False]


def test_levels_of_standstill_grow_with_the_noise_of_what_they_measure() -> None:
    assert AT_REST.speed < STILL.speed < STANDING.speed == RESTING.speed
    assert STILL.w < STANDING.w


@pytest.mark.parametrize(
    ("v", "w", "is_still", "is_standing"),
    [
        (0.0, 0.0, True, True),
        (0.01, 0.0, False, True),
        (0.0, 0.03, False, True),
        (0.1, 0.0, False, False),
        (0.0, -0.1, False, False),
    ],
)
def test_a_robot_is_still_or_stands(v: float, w: float, is_still: bool, is_standing: bool) -> None:
    robot = RobotState(Pose(1.0, 2.0, 3.0), v, w)
    assert (robot.is_still, robot.is_standing) == (is_still, is_standing)


def robot_velocity(robot: RobotState) -> tuple[float, float, float]:
    return robot.vx, robot.vy, robot.w


def test_a_robot_has_a_speed_in_any_direction() -> None:
    robot = RobotState(Pose(0.0, 0.0, 0.0), 0.3, 0.5, vy=-0.4)
    assert robot.speed == pytest.approx(0.5)
    assert robot.velocity == Command(0.3, 0.5, vy=-0.4)
    assert not RobotState(Pose(0.0, 0.0, 0.0), vy=0.1).is_standing


def test_whole_numbers_are_read_as_floats() -> None:
    for robot in (
        RobotState(Pose(1, 2, 3), np.int64(4), 5, vy=6),
        RobotState(Pose(1.0, 2.0, 3.0), 4.0, 5.0, vy=6),
    ):
        assert robot == RobotState(Pose(1.0, 2.0, 3.0), 4.0, 5.0, vy=6.0)
        assert {type(value) for value in (*robot.pose, *robot_velocity(robot))} == {float}
    thing = ObjectState(1, np.int32(2), 3, 4)
    assert thing == ObjectState(1.0, 2.0, 3.0, 4.0)
    assert {type(value) for value in (thing.x, thing.y, thing.vx, thing.vy)} == {float}


@given(SPEED, SPEED, st.floats(-2.0, 2.0))
def test_an_object_continues_at_constant_velocity(vx: float, vy: float, seconds: float) -> None:
    thing = ObjectState(1.0, -2.0, vx, vy)
    later = thing.after(seconds)
    assert (later.x - 1.0, later.y + 2.0) == pytest.approx((vx * seconds, vy * seconds))
    assert (later.vx, later.vy, later.speed) == (vx, vy, thing.speed)
    assert thing.speed == pytest.approx((vx**2 + vy**2) ** 0.5)
    assert thing.is_resting == (thing.speed <= RESTING.speed)


def test_an_object_is_added_or_replaced() -> None:
    world = World(1.0, RobotState(Pose(0.0, 0.0, 0.0)), {"cup": ObjectState(1.0, 0.0)})
    moved = world.with_object("cup", ObjectState(2.0, 0.0)).with_object("ball", ObjectState(3.0, 0))
    assert moved.objects == {"cup": ObjectState(2.0, 0.0), "ball": ObjectState(3.0, 0.0)}
    assert world.objects == {"cup": ObjectState(1.0, 0.0)}
