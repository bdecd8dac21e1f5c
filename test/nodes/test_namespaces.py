"""Two robots in separate namespaces of one domain.

Nodes use exactly the names that the policy allows.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import pytest
from chain_client import ChainClient, chain_of_the_paper
from geometry_msgs.msg import Twist
from process import Processes
from rclpy.node import Node, NodeNameNonExistentError
from ros_client import Client

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import LATCHED, SENSOR_DATA
from ator_ros.resources import share_folder

_ACTION = "/_action/"
POLICY = ET.parse(share_folder() / "security" / "ator_ros.policy.xml").getroot()  # noqa: S314, our own file


@dataclass(frozen=True, slots=True)
class Surface:
    """Full names of the topics, services and actions of one node.

    Parts of an action count as the action.
    """

    publishes: frozenset[str]
    subscribes: frozenset[str]
    replies: frozenset[str]
    requests: frozenset[str]
    executes: frozenset[str]
    calls: frozenset[str]


def surface(observer: Node, name: str, namespace: str = "/") -> Surface:
    """Return the names of a node, as another node on its domain sees them.

    The namespace begins with a slash. Raises rclpy's NodeNameNonExistentError before it is
    discovered.
    """
    replies = _names(observer.get_service_names_and_types_by_node(name, namespace))
    requests = _names(observer.get_client_names_and_types_by_node(name, namespace))
    return Surface(
        publishes=_plain(_names(observer.get_publisher_names_and_types_by_node(name, namespace))),
        subscribes=_plain(_names(observer.get_subscriber_names_and_types_by_node(name, namespace))),
        replies=_plain(replies),
        requests=_plain(requests),
        executes=_actions(replies),
        calls=_actions(requests),
    )


def _names(names_and_types: Iterable[tuple[str, list[str]]]) -> frozenset[str]:
    return frozenset(name for name, _ in names_and_types)


def _plain(names: frozenset[str]) -> frozenset[str]:
    return frozenset(name for name in names if _ACTION not in name)


def _actions(names: frozenset[str]) -> frozenset[str]:
    return frozenset(name.partition(_ACTION)[0] for name in names if _ACTION in name)


def allowed(node: str, namespace: str = "") -> Surface:
    """Return the full names that the profile of a node, here in another namespace, allows."""
    (profile,) = POLICY.iterfind(f".//profile[@node='{node}']")

    def full(name: str) -> str:
        own = name.replace("~", node, 1) if name.startswith("~") else name
        return name if name.startswith("/") else f"{namespace}/{own}"

    def names(kind: str, rule: str) -> frozenset[str]:
        lists = profile.iterfind(f"{kind}s[@{rule}='ALLOW']")
        return frozenset(full(item.text or "") for part in lists for item in part)

    return Surface(
        publishes=names("topic", "publish"),
        subscribes=names("topic", "subscribe"),
        replies=names("service", "reply"),
        requests=names("service", "request"),
        executes=names("action", "execute"),
        calls=names("action", "call"),
    )


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
    observer, profile = robots[""], allowed(node, "/ann")

    def opened() -> object:
        try:
            return surface(observer.node, node, "/ann")
        except NodeNameNonExistentError:
            return None

    try:
        observer.eventually(lambda: opened() == profile, "the node's whole profile")
    except AssertionError:
        assert opened() == profile  # a failing comparison shows the difference


def test_a_client_uses_the_nodes_interfaces_without_cmd_vel() -> None:
    client, nodes = allowed("client"), [allowed(node) for node in ROBOTS["ann"]]
    offered = frozenset.union(*(node.replies for node in nodes))
    assert client.requests == {name for name in offered if "/set_parameters" not in name}
    assert client.subscribes == frozenset.union(*(node.publishes for node in nodes))
    assert client.calls == frozenset.union(*(node.executes for node in nodes))
    assert client.publishes == EVERYWHERE
    assert not client.executes
    assert all(name.startswith("/client/") for name in client.replies)
