"""Causes of missing inputs and of a base that does not move, from facts; several publishers of one state."""

from __future__ import annotations

import pytest
from geometry_msgs.msg import Twist
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_client import Client

from ator_ros.nodes.diagnosis import (
    ClockFacts,
    Endpoint,
    Reception,
    TopicFacts,
    input_cause,
    motion_cause,
    publishers_of,
    rate_problem,
    subscriptions_of,
)
from ator_ros.nodes.qos import COMMANDS, SENSOR_DATA

ODOMETRY, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"
BASE = Endpoint("/base", ODOMETRY)
CLOCK = ClockFacts(("/world",), 0.4)


def topic(*others: Endpoint, elsewhere: tuple[str, ...] = ()) -> TopicFacts:
    """Return the facts of odom."""
    return TopicFacts("odom", "/ann/odom", ODOMETRY, others, elsewhere, domain=7)


def received(*stamps: float, every: float = 0.05, error: Exception | None = None) -> Reception:
    """Return what came: messages with these stamps, and one that was ignored."""
    reception = Reception()
    for number, stamp in enumerate(stamps):
        reception.read(stamp, number * every)
    if error is not None:
        reception.reject(error, len(stamps) * every)
    return reception


STOPPED = received(1.0, 1.05, 1.1)


@pytest.mark.parametrize(
    ("facts", "reception", "clock", "expected"),
    [
        (
            topic(),
            Reception(),
            ClockFacts(),
            "no node publishes /ann/odom in ROS domain 7, and there is no other topic of type "
            "nav_msgs/Odometry: start the base's driver",
        ),
        (
            topic(elsewhere=("/wheels/odom", "/filtered")),
            Reception(),
            ClockFacts(),
            "no node publishes /ann/odom in ROS domain 7; of type nav_msgs/Odometry there is /wheels/odom, "
            "/filtered: remap with -r odom:=/wheels/odom",
        ),
        (
            topic(Endpoint("/base", "geometry_msgs/msg/PoseStamped")),
            Reception(),
            ClockFacts(),
            "odom: expected nav_msgs/Odometry, /base publishes geometry_msgs/PoseStamped",
        ),
        (
            topic(Endpoint("/base", ODOMETRY, incompatible="DURABILITY")),
            Reception(),
            ClockFacts(),
            "odom: the quality of service of /base does not fit: DURABILITY",
        ),
        (topic(BASE), Reception(), ClockFacts(), "odom: /base publishes it, but sends no messages"),
        (
            topic(BASE),
            received(error=ValueError("odom: bad")),
            ClockFacts(),
            "messages of /base are ignored: odom: bad",
        ),
        (
            topic(BASE),
            received(*[3.0] * 6),
            ClockFacts(),
            "odom: the stamps of /base stay at 3.00 s: expected stamps that advance; is it paused, or does "
            "its driver not set them?",
        ),
        (
            topic(Endpoint("/world", ODOMETRY, pauses=True)),
            received(*[3.0] * 6),
            ClockFacts(),
            "odom: the stamps of /world stay at 3.00 s: it is paused; call its service "
            "pause with data: false",
        ),
        (
            topic(BASE),
            received(*[3.0] * 6),
            CLOCK,
            "odom: the stamps of /base stay at 3.00 s, /clock of /world does not advance: the "
            "simulation is paused",
        ),
        (
            topic(BASE),
            STOPPED,
            CLOCK,
            "/clock of /world does not advance: the simulation is paused or has ended",
        ),
        (
            topic(BASE),
            STOPPED,
            ClockFacts(("/world",)),
            "odom: /base sends no more messages: it is paused, blocked or has ended",
        ),
        (
            topic(BASE),
            received(1.0, 1.4, every=0.4),
            ClockFacts(),
            "odom: messages came 0.40 s apart, too rarely for a timeout of 0.3 s; set odom_timeout:=1.6",
        ),
    ],
)
def test_the_cause_of_missing_odometry(
    facts: TopicFacts, reception: Reception, clock: ClockFacts, expected: str
) -> None:
    assert input_cause(facts, reception, clock, timeout=0.3) == expected


def test_odometry_too_rare_to_drive_by_is_named_with_what_to_do() -> None:
    rare = received(*(0.2 * i for i in range(9)), every=0.2)
    assert rate_problem("odom", rare, timeout=0.3) == (
        "odom: messages came 0.20 s apart, too rarely for a timeout of 0.3 s; set odom_timeout:=0.8: "
        "the robot pauses between them"
    )
    assert "0.20 s apart by their stamps; expected 10 or more" in rate_problem("odom", rare, timeout=0.8)
    slow_simulation = received(*(0.05 * i for i in range(9)), every=0.2)
    assert rate_problem("odom", slow_simulation, timeout=1.2) == ""


@pytest.mark.parametrize(
    ("receivers", "mismatch", "rivals", "expected"),
    [
        ((), "", (), "no node subscribes to /cmd_vel in ROS domain 0, and there is no other topic of type"),
        ((), "cmd_vel: another type", (), "cmd_vel: another type"),
        ((Endpoint("/monitor", TWIST),), "", (), "cmd_vel is received only by /monitor"),
        ((Endpoint("/base", TWIST),), "", ("/teleop",), "cmd_vel: /teleop publishes commands as well"),
        (
            (Endpoint("/monitor", TWIST), Endpoint("/base", TWIST, "DEADLINE")),
            "",
            (),
            "the quality of service of /base does not fit: DEADLINE",
        ),
    ],
)
def test_the_cause_of_a_base_that_does_not_follow(
    receivers: tuple[Endpoint, ...], mismatch: str, rivals: tuple[str, ...], expected: str
) -> None:
    said = motion_cause(TopicFacts("cmd_vel", "/cmd_vel", TWIST, receivers), mismatch, rivals)
    assert expected in said


def test_plain_subscriptions_and_publishers_fit_and_stricter_ones_do_not(client: Client) -> None:
    """Default durations are 0 in a profile of rclpy, and infinite in the graph."""
    node, strict = client.node, QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    client.within(lambda: node.create_subscription(Twist, "plain", print, 10))
    client.within(lambda: node.create_publisher(Twist, "plain", 10))
    client.within(lambda: node.create_publisher(Twist, "lossy", SENSOR_DATA))
    client.eventually(lambda: node.count_publishers("lossy") and node.count_publishers("plain"), "the graph")
    (base,) = subscriptions_of(node, "plain", Twist, COMMANDS).others
    (sender,) = publishers_of(node, "plain", Twist).others
    (lossy,) = publishers_of(node, "lossy", Twist, strict).others
    assert (base.incompatible, sender.incompatible) == ("", "")
    assert "reliable" in lossy.incompatible
