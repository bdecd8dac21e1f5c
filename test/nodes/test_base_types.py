"""Bases that subscribe to Twist or TwistStamped, and bases that cannot receive commands."""

import pytest
from chain_client import ChainClient, call
from conftest import Host
from geometry_msgs.msg import Twist, TwistStamped
from moving_base import MovingBase
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.commands import CommandPublisher
from ator_ros.world.state import STOP, Command

CLIENT = {"silent": True}
NEAR = [call("goToPose", Pose(0.5, 0.0, 0.0))]
SETTINGS = {"odom_timeout": 2.0, "start_timeout": 20.0}


@pytest.mark.parametrize("kind", [Twist, TwistStamped])
def test_the_type_that_the_base_subscribes_to_is_published(
    host: Host, client: Client, kind: type
) -> None:
    host("executor", **SETTINGS)
    base = MovingBase(client, kind)  # discovered after the start
    chains = ChainClient(client, commands=kind)
    outcome = chains.send(NEAR).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason
    assert base.pose.x == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("set_to", "kind", "other"), [("true", Twist, "false"), ("false", TwistStamped, "true")]
)
def test_a_base_of_the_other_type_is_reported_with_the_remedy(
    host: Host, client: Client, set_to: str, kind: type, other: str
) -> None:
    node = host("executor", stamped_commands=set_to, **SETTINGS)
    health = client.statuses()
    MovingBase(client, kind)
    published = {"true": "TwistStamped", "false": "Twist"}[set_to]
    expected = (
        f"cmd_vel: the base /test_client subscribes to geometry_msgs/{kind.__name__}, this node "
        "publishes "
        f"{published}; set stamped_commands:={other}"
    )
    chains = ChainClient(client, commands=kind)
    outcome = chains.send(NEAR).outcome()
    assert outcome.code == Outcome.BASE_FAULT
    assert expected in outcome.reason
    assert expected in node.output
    client.eventually(lambda: expected in health[-1].message, "diagnostics")


def test_a_base_with_another_topic_is_reported(host: Host, client: Client) -> None:
    host("executor", **SETTINGS)
    MovingBase(client, topic="mobile_base/commands")
    outcome = ChainClient(client, commands=None).send(NEAR).outcome()
    assert outcome.code == Outcome.BASE_FAULT
    assert "no node subscribes to /cmd_vel in ROS domain" in outcome.reason
    assert "remap with -r cmd_vel:=/mobile_base/commands" in outcome.reason


def test_an_incompatible_quality_of_service_is_reported(host: Host, client: Client) -> None:
    host("executor", **SETTINGS)
    MovingBase(client, qos=QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    outcome = ChainClient(client, commands=None).send(NEAR).outcome()
    assert outcome.code == Outcome.BASE_FAULT
    assert "cmd_vel: the quality of service of /test_client does not fit: " in outcome.reason
    assert outcome.reason.endswith(" fit: Volatile publisher and transient local subscription")


@pytest.mark.long
def test_the_result_reports_a_base_at_half_the_commanded_speed(host: Host, client: Client) -> None:
    host("executor", **SETTINGS)
    MovingBase(client, share=0.5).set_pace(3.0)
    outcome = ChainClient(client).send([call("goToPose", Pose(2.0, 0.0, 0.0))]).outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason
    assert "; the base drives at about 50 % of the commanded speed" in outcome.reason


@pytest.mark.parametrize(("kind", "other"), [(Twist, TwistStamped), (TwistStamped, Twist)])
@pytest.mark.parametrize("odometry", ["odom", "localization"])
def test_a_viewer_with_the_other_type_is_not_the_base(
    client: Client, domain: int, kind: type, other: type, odometry: str
) -> None:
    """The one that takes the published type first is served; no other is called the base."""
    base, viewer = (Client(domain, name=name, silent=True) for name in ("base", "viewer"))
    commands = CommandPublisher(client.node, stamped="auto", frame="base_link")
    try:
        MovingBase(base, kind, odom=odometry)
        client.eventually(lambda: client.within(commands.adapt) or commands.connected, "the base")
        viewer.listen(other, "cmd_vel", 10)
        client.eventually(lambda: client.node.count_subscribers("cmd_vel") == 2, "the viewer")
        client.within(commands.adapt)
        assert commands.kind is kind
        assert commands.mismatch() == ""
        expected = "cmd_vel is received by /base; if /viewer is the base: /viewer subscribes to"
        if odometry == "odom":  # then it is known which node is the base
            expected = "cmd_vel is received only by /base"
        client.eventually(lambda: commands.cause().startswith(expected), expected)
    finally:
        base.close()
        viewer.close()


@pytest.mark.parametrize(("kind", "other"), [(Twist, TwistStamped), (TwistStamped, Twist)])
def test_the_node_that_publishes_odometry_is_the_base_also_if_a_viewer_came_first(
    client: Client, domain: int, kind: type, other: type
) -> None:
    base, viewer = (Client(domain, name=name, silent=True) for name in ("base", "viewer"))
    commands = CommandPublisher(client.node, stamped="auto", frame="base_link")
    try:
        viewer.listen(other, "cmd_vel", 10)
        client.eventually(lambda: client.within(commands.adapt) or commands.connected, "the viewer")
        moving = MovingBase(base, kind)

        def received() -> bool:
            client.within(commands.adapt)
            commands.publish(STOP, 0.0)
            return moving.received > 0

        client.eventually(received, "a command at the base")
        assert commands.kind is kind
        assert commands.mismatch() == ""
    finally:
        base.close()
        viewer.close()


@pytest.mark.parametrize(("kind", "other"), [(Twist, TwistStamped), (TwistStamped, Twist)])
def test_a_base_that_drives_keeps_its_type_while_only_a_viewer_is_in_the_graph(
    client: Client, domain: int, kind: type, other: type
) -> None:
    base, viewer = (Client(domain, name=name, silent=True) for name in ("base", "viewer"))
    commands = CommandPublisher(client.node, stamped="auto", frame="base_link")
    try:
        MovingBase(base, kind)
        client.eventually(lambda: client.within(commands.adapt) or commands.connected, "the base")
        viewer.listen(other, "cmd_vel", 10)
        client.eventually(lambda: client.node.count_subscribers("cmd_vel") == 2, "the viewer")
        client.within(lambda: commands.publish(Command(0.1, 0.0), 0.0))
    finally:
        base.close()
    try:
        client.eventually(lambda: client.node.count_subscribers("cmd_vel") == 1, "the viewer alone")
        client.within(commands.adapt)
        assert commands.kind is kind
        client.within(lambda: commands.publish(STOP, 0.0))
        client.within(commands.adapt)
        assert commands.kind is other
    finally:
        viewer.close()
