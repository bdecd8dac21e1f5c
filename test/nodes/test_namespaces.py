"""Two robots in separate namespaces of one domain.

Nodes use exactly the names that the policy allows.
"""

from collections.abc import Iterator

import pytest
from chain_client import ChainClient, chain_of_the_paper
from geometry_msgs.msg import Twist
from process import Processes
from profiles import allowed, assert_profile
from ros_client import Client

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import LATCHED, SENSOR_DATA

ROBOTS: dict[str, dict[str, dict[str, float]]] = {
    "ann": {
        "simulation": {"real_time_factor": 5.0, "command_wait": 1.0, "publish_clock": True},
        "executor": {"odom_timeout": 5.0, "refinement_timeout": 10.0},
        "refinement": {},
    },
    "bob": {"simulation": {}, "executor": {"odom_timeout": 5.0}},
}
EVERYWHERE = {"/parameter_events", "/rosout"}


@pytest.fixture(scope="module")
def robots(shared: tuple[Processes, Client]) -> Iterator[dict[str, Client]]:
    """Start the nodes of both robots; yield a client for each, and one ("") without a namespace."""
    processes, unnamed = shared
    for robot, nodes in ROBOTS.items():
        for name, parameters in nodes.items():
            processes.start(name, namespace=robot, **parameters)
    clients = {robot: Client(unnamed.domain, robot) for robot in ROBOTS}
    yield {"": unnamed, **clients}
    for client in clients.values():
        client.close()


@pytest.mark.long
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


@pytest.mark.parametrize("node", ROBOTS["ann"])
def test_a_node_uses_exactly_what_its_profile_allows(robots: dict[str, Client], node: str) -> None:
    assert_profile(robots[""], node, "ann")


def test_a_client_uses_the_nodes_interfaces_without_cmd_vel() -> None:
    client, nodes = allowed("client"), [allowed(node) for node in (*ROBOTS["ann"], "watch", "team")]
    offered = frozenset.union(*(node.replies for node in nodes))
    assert client.requests == {name for name in offered if "/set_parameters" not in name}
    assert client.subscribes == frozenset.union(*(node.publishes for node in nodes))
    assert client.calls == frozenset.union(*(node.executes for node in nodes))
    assert client.publishes == EVERYWHERE
    assert not client.executes
    assert all(name.startswith("/client/") for name in client.replies)
