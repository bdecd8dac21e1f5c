"""The simulated world of several robots, without a node around it."""

from __future__ import annotations

import dataclasses
import math

import pytest

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.simulated_world import SimulatedRobot, SimulatedWorld
from ator_ros.simulation.sensors import SensorConfig, Sensors
from ator_ros.world.messages import MessageError
from ator_ros.world.state import Command

ROBOT = SOCCER.robot()
START = Pose(-2.0, 0.0, 0.0)


def test_placing_a_robot_leaves_the_odometry_of_the_others() -> None:
    config = SensorConfig(drift=0.1)
    ann = SimulatedRobot("ann", ROBOT, Sensors(config, 1), Pose(0.0, 0.0, 0.0))
    bob = SimulatedRobot("bob", ROBOT, Sensors(config, 2), Pose(0.0, 2.0, 0.0))
    world = SimulatedWorld([ann, bob], {})
    for _ in range(40):
        world.command(Command(0.6, 0.0), 0)
        list(world.tick())
    before = ann.observed.robot.pose
    world.place_robot(Pose(-1.0, -2.0, 0.0), 1, v=0.0, w=0.0)
    after = ann.observed.robot.pose
    assert math.hypot(after.x - before.x, after.y - before.y) < 1e-3
    assert bob.observed.robot.pose.distance(Pose(-1.0, -2.0, 0.0)) < 1e-6


# Bodies that would overlap are not placed

FRONT = ROBOT.front + ROBOT.holder_length
BALL = ROBOT.scene.radius("ball")
BAY = ROBOT.scene.bays[0]


def single(
    start: Pose = START, ball: tuple[float, float] = (0.0, 0.0)
) -> tuple[SimulatedWorld, SimulatedRobot]:
    robot = SimulatedRobot("", ROBOT, Sensors(SensorConfig(), 1), start)
    return SimulatedWorld([robot], {"ball": ball}), robot


def speeds_after_a_second(world: SimulatedWorld, robot: SimulatedRobot) -> tuple[float, float]:
    for _ in range(20):
        list(world.tick())
    return abs(robot.observed.robot.v), robot.observed.objects["ball"].speed


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        (lambda world: world.place_object("ball", -2.0, 0.1, vx=0.0, vy=0.0), "overlaps robot"),
        (
            lambda world: world.place_object("ball", -2.0 + FRONT - 0.01, 0.14, vx=0.0, vy=0.0),
            "overlaps robot",
        ),
        (lambda world: world.place_object("ball", BAY.x, BAY.y + BAY.width / 2, vx=0.0, vy=0.0), "a wall"),
        (lambda world: world.place_robot(Pose(0.1, 0.0, 1.0), 0, v=0.0, w=0.0), "overlaps the ball"),
        (lambda world: world.place_robot(Pose(-FRONT, 0.14, 0.0), 0, v=0.0, w=0.0), "overlaps the ball"),
        (lambda world: world.place_robot(Pose(BAY.x, BAY.y + BAY.width / 2, 0.0), 0, v=0.0, w=0.0), "a wall"),
    ],
)
def test_nothing_is_placed_in_another_body(place, expected: str) -> None:
    world, robot = single()
    before = robot.observed
    with pytest.raises(MessageError, match=f"expected a free place, got one that .*{expected}"):
        place(world)
    assert speeds_after_a_second(world, robot) == pytest.approx((0.0, 0.0), abs=1e-3)
    after = robot.observed
    assert after.robot.pose.distance(before.robot.pose) < 1e-3
    assert math.hypot(after.objects["ball"].x, after.objects["ball"].y) < 1e-3


def test_a_refused_place_does_not_stop_a_robot_that_drives() -> None:
    (world, robot), (other, undisturbed) = single(), single()
    for each in (world, other):
        for _ in range(10):
            each.command(Command(0.5, 0.2), 0)
            list(each.tick())
    with pytest.raises(MessageError, match="overlaps the ball"):
        world.place_robot(Pose(0.1, 0.0, 0.0), 0, v=0.0, w=0.0)
    for each in (world, other):
        list(each.tick())
    assert robot.observed.robot.pose.distance(undisturbed.observed.robot.pose) < 1e-9
    assert robot.observed.robot.v > 0.1


def test_a_ball_can_be_placed_in_the_holder() -> None:
    world, robot = single()
    world.place_object("ball", -2.0 + ROBOT.hold, 0.0, vx=0.0, vy=0.0)
    assert speeds_after_a_second(world, robot) == pytest.approx((0.0, 0.0), abs=0.01)
    world.remove_object("ball")
    world.place_robot(Pose(-2.0 + ROBOT.hold, 0.0, 0.0), 0, v=0.0, w=0.0)  # where the ball was


@pytest.mark.parametrize(
    ("start", "ball", "expected"),
    [
        (Pose(0.0, 0.0, 0.0), (0.1, 0.0), "ball_start: expected a free place, got one that overlaps robot"),
        (Pose(BAY.x, BAY.y + BAY.width / 2, 0.0), (0.0, 0.0), "robot_start: .* overlaps a wall"),
        (Pose(-2.0, 0.0, 0.0), (BAY.x, BAY.y + BAY.width / 2), "ball_start: .* overlaps a wall"),
    ],
)
def test_a_world_does_not_start_with_bodies_in_each_other(
    start: Pose, ball: tuple[float, float], expected: str
) -> None:
    with pytest.raises(MessageError, match=expected):
        single(start, ball)


def test_two_objects_are_not_placed_in_each_other() -> None:
    objects = {"ball": ROBOT.scene.objects["ball"], "box": ROBOT.scene.objects["ball"]}
    robot = dataclasses.replace(ROBOT, scene=dataclasses.replace(ROBOT.scene, objects=objects))
    ann = SimulatedRobot("", robot, Sensors(SensorConfig(), 1), Pose(-2.0, 0.0, 0.0))
    world = SimulatedWorld([ann], {"ball": (0.0, 0.0), "box": (1.0, 0.0)})
    with pytest.raises(MessageError, match="overlaps the ball"):
        world.place_object("box", 0.5 * BALL, 0.0, vx=0.0, vy=0.0)
    world.place_object("box", 2.0 * BALL, 0.0, vx=0.0, vy=0.0)
