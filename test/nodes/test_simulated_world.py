"""The simulated world of several robots, without a node."""

import math

import pytest

from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.simulated_world import SimulatedRobot, SimulatedWorld
from ator_ros.simulation.sensors import SensorConfig, Sensors
from ator_ros.world.readers import MessageError

ROBOT = SOCCER.robot()
START = Pose(-2.0, 0.0, 0.0)


# Overlapping bodies are not placed

FRONT = ROBOT.front + ROBOT.holder_length
BALL = ROBOT.scene.radius("ball")
BAY = ROBOT.scene.bays[0]


def single(
    start: Pose = START, ball: tuple[float, float] = (0.0, 0.0)
) -> tuple[SimulatedWorld, SimulatedRobot]:
    robot = SimulatedRobot("", Sensors(SensorConfig(), 1), start)
    return SimulatedWorld(ROBOT, [robot], {"ball": ball}), robot


def speeds_after_a_second(world: SimulatedWorld, robot: SimulatedRobot) -> tuple[float, float]:
    for _ in range(20):
        list(world.tick())
    return abs(robot.observed.robot.vx), robot.observed.objects["ball"].speed


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        (lambda world: world.place_object("ball", -2.0, 0.1, vx=0.0, vy=0.0), "overlaps robot"),
        (
            lambda world: world.place_object("ball", -2.0 + FRONT - 0.01, 0.14, vx=0.0, vy=0.0),
            "overlaps robot",
        ),
        (
            lambda world: world.place_object("ball", BAY.x, BAY.y + BAY.width / 2, vx=0.0, vy=0.0),
            "a wall",
        ),
        (
            lambda world: world.place_robot(Pose(0.1, 0.0, 1.0), 0),
            "overlaps the ball",
        ),
        (
            lambda world: world.place_robot(Pose(-FRONT, 0.14, 0.0), 0),
            "overlaps the ball",
        ),
        (
            lambda world: world.place_robot(Pose(BAY.x, BAY.y + BAY.width / 2, 0.0), 0),
            "a wall",
        ),
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


def test_a_ball_can_be_placed_in_the_holder() -> None:
    world, robot = single()
    world.place_object("ball", -2.0 + ROBOT.hold, 0.0, vx=0.0, vy=0.0)
    assert speeds_after_a_second(world, robot) == pytest.approx((0.0, 0.0), abs=0.01)
    world.remove_object("ball")
    # at the former place of the ball
    world.place_robot(Pose(-2.0 + ROBOT.hold, 0.0, 0.0), 0)


@pytest.mark.parametrize(
    ("start", "ball", "expected"),
    [
        (
            Pose(0.0, 0.0, 0.0),
            (0.1, 0.0),
            "ball_start: expected a free place, got one that overlaps robot",
        ),
        (Pose(BAY.x, BAY.y + BAY.width / 2, 0.0), (0.0, 0.0), "robot_start: .* overlaps a wall"),
        (Pose(-2.0, 0.0, 0.0), (BAY.x, BAY.y + BAY.width / 2), "ball_start: .* overlaps a wall"),
    ],
)
def test_a_world_does_not_start_with_overlapping_bodies(
    start: Pose, ball: tuple[float, float], expected: str
) -> None:
    with pytest.raises(MessageError, match=expected):
        single(start, ball)
