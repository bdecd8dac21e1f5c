"""Leases of goals, and topics that are none."""

import pytest
from chain_client import PATROL
from conftest import Host
from geometry_msgs.msg import Twist
from moving_base import MovingBase
from ros_client import Client
from std_msgs.msg import Empty

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, Outcome, TopChain
from ator_ros.nodes.chain_client import ChainClient
from ator_ros.nodes.leases import LeaseWatch, publish_lease
from ator_ros.nodes.qos import LATCHED, LEASE, NEWEST
from ator_ros.world.readers import MessageError

CLIENT = {"silent": True}


def refusal(client: Client, topic: str) -> str:
    """Return why a topic is refused; empty if it is watched."""

    def watch() -> str:
        try:
            LeaseWatch(client.node).watch(topic)
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


@pytest.mark.long
def test_the_newest_lease_is_watched_until_its_client_is_gone(client: Client) -> None:
    lease = LeaseWatch(client.node)
    topic = client.within(lambda: publish_lease(client.node))
    gone = Client(client.domain, name="gone", silent=True)
    other = publish_lease(gone.node)
    for name in (other, topic, topic, other):
        client.within(lambda name=name: lease.watch(name))
        assert not lease.has_ended
    assert client.node.count_subscribers(topic) == 0
    client.eventually(lambda: client.node.count_publishers(other), "the other client")
    gone.close()
    client.eventually(lambda: lease.has_ended, "the end of the lease")
    client.within(lambda: lease.watch(""))
    assert not lease.has_ended


def test_a_goal_ends_with_its_client(host: Host, client: Client) -> None:
    host("executor", odom_timeout=10.0)
    base = MovingBase(client)
    records = client.listen(ChainPerformance, "performance/chain", LATCHED)
    gone = Client(client.domain, name="gone", silent=True)
    sender = gone.within(lambda: ChainClient(gone.node))
    gone.eventually(sender.is_ready, "the executor")
    gone.wait_for_discovery_by("execute_chain")
    goal = ExecuteChain.Goal(chain=TopChain(calls=PATROL))
    gone.within(lambda: sender.send(goal))
    client.eventually(lambda: base.commanded.linear.x > 0.2, "the robot drives")
    gone.close()
    client.eventually(lambda: records, "the end of the goal")
    assert records[0].outcome.code == Outcome.CANCELED
    assert "the client of this goal is gone" in records[0].outcome.reason
    client.eventually(lambda: base.commanded.linear.x == 0.0, "the robot stands")
