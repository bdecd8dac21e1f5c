"""Leases of goals, and topics that are none."""

import pytest
from geometry_msgs.msg import Twist
from ros_client import Client
from std_msgs.msg import Empty

from ator_ros.nodes.leases import Leases, publish_lease
from ator_ros.nodes.qos import LEASE, NEWEST
from ator_ros.world.messages import MessageError

CLIENT = {"silent": True}


def refusal(client: Client, topic: str) -> str:
    """Return why a topic is refused; empty if it is watched."""

    def watch() -> str:
        try:
            Leases(client.node).watch(topic)
        except MessageError as error:
            return str(error)
        return ""

    return str(client.within(watch))


@pytest.mark.parametrize("shared", [False, True])
def test_a_topic_of_another_type_is_no_lease(client: Client, shared: bool) -> None:
    """If another node publishes the right type on it, only the subscription fails."""
    node = client.node
    client.within(lambda: node.create_publisher(Twist, "cmd_vel", NEWEST))
    other = Client(client.domain, name="other", silent=True)
    try:
        if shared:
            other.within(lambda: other.node.create_publisher(Empty, "cmd_vel", LEASE))
        senders = 2 if shared else 1
        client.eventually(lambda: node.count_publishers("cmd_vel") == senders, "the graph")
        expected = "lease: expected the name of a topic of type std_msgs/Empty, got '/cmd_vel'"
        of_type = "" if shared else " of type geometry_msgs/msg/Twist"
        assert refusal(client, "/cmd_vel") == expected + of_type
    finally:
        other.close()


@pytest.mark.parametrize("name", ["a b", "/", "x" * 300, "é"])
def test_an_invalid_name_is_no_lease(client: Client, name: str) -> None:
    assert refusal(client, name).startswith("lease: expected the name of a topic")


def test_a_lease_is_watched_until_its_last_goal_has_ended(client: Client) -> None:
    leases = Leases(client.node)
    topic = client.within(lambda: publish_lease(client.node))
    for step in (leases.watch, leases.watch, leases.release):
        client.within(lambda step=step: step(topic))
    assert not leases.has_ended(topic)
    client.within(lambda: leases.release(topic))
    client.eventually(lambda: not client.node.count_subscribers(topic), "the end of the watch")
