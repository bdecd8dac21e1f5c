"""The simulated world of several robots, without a node around it."""

from __future__ import annotations

import math

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.simulated_world import SimulatedRobot, SimulatedWorld
from ator_ros.simulation.sensors import SensorConfig, Sensors
from ator_ros.world.state import Command

ROBOT = SOCCER.robot()


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
