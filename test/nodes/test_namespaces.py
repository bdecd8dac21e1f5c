"""Two robots on one domain, each with its three nodes in a separate namespace."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from chain_client import ChainClient, chain_of_the_paper
from geometry_msgs.msg import Twist
from graph import surface
from process import Processes
from rclpy.node import NodeNameNonExistentError
from ros_client import Client

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import LATCHED, SENSOR_DATA

pytestmark = pytest.mark.node

ROBOTS = {
    "ann": {"real_time_factor": 5.0, "command_wait": 1.0, "publish_clock": True},
    "bob": {"real_time_factor": 2.0},
}
NODES: dict[str, dict[str, float]] = {
    "simulation": {},
    "executor": {"odom_timeout": 5.0, "refinement_timeout": 10.0},
    "refinement": {},
}
GLOBAL = {
    "/diagnostics",  # shared by all robots; each status has the full node name
    "/parameter_events",  # absolute in every ROS node
    "/rosout",  # likewise
    "/clock",  # the topic of simulated time; off by default
}


@pytest.fixture(scope="module")
def robots(shared: tuple[Processes, Client]) -> Iterator[dict[str, Client]]:
    """Start all nodes of both robots; yield a client for each, and one ("") without a namespace."""
    processes, unnamed = shared
    for robot, world in ROBOTS.items():
        for name, parameters in NODES.items():
            settings = world if name == "simulation" else parameters
            processes.start(name, namespace=robot, **settings)
    clients = {robot: Client(unnamed.domain, robot) for robot in ROBOTS}
    yield {"": unnamed, **clients}
    for client in clients.values():
        client.close()


def test_a_chain_moves_one_robot_only(robots: dict[str, Client]) -> None:
    ann, bob = robots["ann"], robots["bob"]
    strange = [
        client.listen(kind, topic, qos)
        for client in (bob, robots[""])
        for kind, topic, qos in (
            (Twist, "cmd_vel", SENSOR_DATA),
            (ChainPerformance, "performance/chain", LATCHED),
        )
    ]
    bob.robot()
    result = ChainClient(ann).send(chain_of_the_paper(), refine=True).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert result.record.refinement
    assert ann.ball().x > 3.0
    assert all(robot.pose.distance(Pose(-2.0, 0.0, 0.0)) < 0.02 for _, robot in bob.robots)
    assert max(abs(ball.x) + abs(ball.y) for _, ball in bob.balls) < 0.02
    assert not any(strange)
    assert not robots[""].robots


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", NODES)
def test_names_of_a_node_are_in_its_namespace(robots: dict[str, Client], robot: str, name: str) -> None:
    observer = robots[""]

    def opened() -> frozenset[str]:
        try:
            return surface(observer.node, name, f"/{robot}").names
        except NodeNameNonExistentError:
            return frozenset()

    observer.eventually(lambda: len(opened()) > len(GLOBAL), f"the node /{robot}/{name}")
    assert {full for full in opened() if not full.startswith(f"/{robot}/")} <= GLOBAL
