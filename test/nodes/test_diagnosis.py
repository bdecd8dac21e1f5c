"""Diagnosed causes of missing inputs and of a base that does not move.

Several publishers of a state.
"""

from types import SimpleNamespace
from typing import Any

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_client import Client

from ator_ros.nodes.commands import CommandPublisher
from ator_ros.nodes.diagnostics import Diagnosis, several_publishers
from ator_ros.nodes.qos import NEWEST, SENSOR_DATA
from ator_ros.nodes.subscriptions import Input, TfListener

RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
CLIENT = {"silent": True}


def received(client: Client, *stamps: float, qos: QoSProfile = SENSOR_DATA) -> Diagnosis:
    """Return the diagnosis of odometry with these stamps."""
    odom = Input("odom", Odometry, qos)
    for number, stamp in enumerate(stamps):
        odom.read(stamp, 0.05 * number)
    subscribed: Any = SimpleNamespace(inputs={"odom": odom}, tf=TfListener(client.node))
    return Diagnosis(client.node, subscribed)


def test_the_cause_of_missing_odometry(client: Client) -> None:
    node = client.node

    def cause(*stamps: float, **given: Any) -> str:
        return received(client, *stamps, **given).cause("odom", 0.3)

    assert cause().endswith(
        f"no node publishes /odom in ROS domain {client.domain}, and there is no other topic of "
        "type "
        "nav_msgs/Odometry: start the node that publishes it"
    )
    client.within(lambda: node.create_publisher(Odometry, "odom", SENSOR_DATA))
    client.eventually(lambda: node.count_publishers("odom"), "the graph")
    client.within(lambda: [node.create_publisher(Odometry, "ball", SENSOR_DATA) for _ in range(2)])
    client.eventually(
        lambda: "ball: expected one pub" in several_publishers(node, ["odom", "ball"]),
        "a second publisher",
    )
    for came, expected in (
        (cause(), "odom: /test_client publishes it, but sends no messages"),
        (
            cause(*[3.0] * 6),
            "odom: the stamps of /test_client stay at 3.00 s: expected stamps that advance; is the "
            "simulation paused, or does the driver not set them?",
        ),
        (
            cause(1.0, 1.05, 1.1),
            "odom: /test_client sends no more messages: it is paused, blocked or has ended",
        ),
    ):
        assert came == expected
    unfit = cause(qos=RELIABLE)
    assert unfit.startswith("odom: the quality of service of /test_client does not fit: ")
    assert "reliable" in unfit


def test_the_cause_of_a_base_that_does_not_follow(client: Client, domain: int) -> None:
    others = Client(domain, "base", silent=True)
    cause = CommandPublisher(client.node, stamped="false", frame="").cause
    try:
        others.listen(Twist, "/cmd_vel", 10)
        client.eventually(
            lambda: cause() == "cmd_vel is received only by /base/test_client", "a base"
        )
        others.within(lambda: others.node.create_publisher(Twist, "/cmd_vel", NEWEST))
        client.eventually(
            lambda: cause() == "cmd_vel: /base/test_client publishes commands as well", "a rival"
        )
    finally:
        others.close()


def test_a_node_that_was_killed_and_started_again_is_one_publisher(client: Client) -> None:
    """DDS lists a killed node for a while; a node of one name in another process may be it."""
    drivers = [Client(client.domain, name=name, silent=True) for name in ("driver", "driver", "b")]
    try:
        for driver in drivers[:2]:
            driver.within(lambda node=driver.node: node.create_publisher(Odometry, "odom", NEWEST))
        client.eventually(lambda: client.node.count_publishers("odom") == 2, "both drivers")
        assert several_publishers(client.node, ["odom"]) == ""
        b = drivers[2]
        b.within(lambda: b.node.create_publisher(Odometry, "odom", NEWEST))
        expected = "odom: expected one publisher, got 2: /b, /driver"
        client.eventually(lambda: several_publishers(client.node, ["odom"]) == expected, expected)
    finally:
        for driver in drivers:
            driver.close()
