"""The SROS2 policy allows exactly the topics, services and actions in the nodes' graph."""

from __future__ import annotations

import pytest
from graph import surface
from process import Processes
from rclpy.node import NodeNameNonExistentError
from ros_client import Client
from sros2_policy import allowed, read_policy

from ator_ros.resources import share_folder

POLICY = read_policy(share_folder() / "security" / "ator_ros.policy.xml")
NODES: dict[str, dict[str, bool]] = {"simulation": {"publish_clock": True}, "executor": {}, "refinement": {}}
EVERYWHERE = {"/parameter_events", "/rosout"}


@pytest.fixture(scope="module")
def observer(shared: tuple[Processes, Client]) -> Client:
    """Start the three nodes and return a client."""
    for name, parameters in NODES.items():
        shared[0].start(name, **parameters)
    return shared[1]


@pytest.mark.node
@pytest.mark.parametrize("node", NODES)
def test_a_node_uses_exactly_what_its_profile_allows(observer: Client, node: str) -> None:
    profile = allowed(POLICY, node)

    def opened() -> object:
        try:
            return surface(observer.node, node)
        except NodeNameNonExistentError:
            return None

    try:
        observer.eventually(lambda: opened() == profile, "the node's whole profile")
    except AssertionError:
        assert opened() == profile  # a failing comparison shows the difference


def test_a_client_uses_the_nodes_interfaces_without_cmd_vel() -> None:
    client, nodes = allowed(POLICY, "client"), [allowed(POLICY, node) for node in NODES]
    offered = frozenset.union(*(node.replies for node in nodes))
    assert client.requests == {name for name in offered if "/set_parameters" not in name}
    assert client.subscribes == frozenset.union(*(node.publishes for node in nodes))
    assert client.calls == frozenset.union(*(node.executes for node in nodes))
    assert client.publishes == EVERYWHERE
    assert not client.executes
    assert all(name.startswith("/client/") for name in client.replies)
