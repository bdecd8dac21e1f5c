"""Invalid input of the nodes' topics: reported clearly, without motion or crash."""

import math
from collections.abc import Iterator
from operator import attrgetter

import pytest
from chain_client import ChainClient
from hosted import Hosted
from nav_msgs.msg import Odometry
from ros_client import Client, values_of
from std_msgs.msg import String

from ator_ros.geometry import Pose
from ator_ros.nodes.messages import object_odometry_of, odometry_of
from ator_ros.nodes.network import PROFILES, free_domain
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.world.state import ObjectState, RobotState

pytestmark = pytest.mark.node

GOAL = Pose(1.0, 0.0, 0.0)
SENSED = {"odom": "/sensed/odom", "ball": "/sensed/ball"}
"""Topics of the executor in this file, so that the test's client receives no invalid messages."""


class Sensors:
    """Odometry and ball of a robot at rest at the origin, published by the test."""

    def __init__(self, client: Client, other: Client) -> None:
        self._odom = client.node.create_publisher(Odometry, SENSED["odom"], SENSOR_DATA)
        self._ball = client.node.create_publisher(Odometry, SENSED["ball"], SENSOR_DATA)
        # A separate participant, since a topic has one type within a participant.
        self._words = other.node.create_publisher(String, SENSED["odom"], SENSOR_DATA)
        self._time = 1.0

    def send(
        self, field: str = "header.frame_id", value: object = "odom", *, ball: bool = False
    ) -> None:
        """Publish the next state.

        `value` is that of a field of the ball's message or the odometry.
        """
        self._time += 0.05
        robot = odometry_of(
            self._time, RobotState(Pose(0.0, 0.0, 0.0)), frame="odom", child="base_link"
        )
        place = object_odometry_of(self._time, ObjectState(-2.0, 1.0), frame="odom", height=0.1)
        part, _, name = field.rpartition(".")
        setattr(attrgetter(part)(place if ball else robot), name, value)
        self._words.publish(String(data="another type of message"))
        self._ball.publish(place)
        self._odom.publish(robot)


@pytest.fixture(scope="module")
def hosted() -> Iterator[tuple[Hosted, ChainClient, Sensors]]:
    with pytest.MonkeyPatch.context() as patch, free_domain() as domain:
        patch.setenv(PROFILES, "")
        client, other = Client(domain), Client(domain, "other")
        remapped = [word for pair in SENSED.items() for word in ("-r", "{}:={}".format(*pair))]
        node = Hosted("executor", domain, str, *remapped, odom_timeout=2.0, start_timeout=5.0)
        yield node, ChainClient(client), Sensors(client, other)
        node.close()
        client.close()
        other.close()


X, FRAME = "pose.pose.position.x", "header.frame_id"
INVALID = [
    (X, math.nan, False, "odom.pose.pose.position.x: expected a finite number"),
    ("pose.pose.orientation.w", 0.0, False, "odom.pose.pose.orientation: expected a quaternion"),
    (FRAME, "attic", False, "odom.header.frame_id: expected the frame 'odom', got 'attic'"),
    (X, math.nan, True, "ball.pose: position.x: expected a finite number"),
    (FRAME, "attic", True, "ball.header.frame_id: expected the frame 'odom', got 'attic'"),
    ("header.stamp.sec", 1_700_000_000, True, "ball.header.stamp: expected about odometry's"),
]


@pytest.mark.parametrize(("field", "value", "ball", "expected"), INVALID)
def test_invalid_sensor_messages_are_reported_and_move_nothing(
    hosted, field, value, ball, expected
) -> None:
    node, chains, sensors = hosted
    count, health = len(chains.commands), chains.ros.statuses()

    def reported() -> bool:
        sensors.send(field, value, ball=ball)
        return any(expected in values_of(status)["last error"] for status in health)

    chains.ros.eventually(reported, expected)
    assert all(command.linear.x == command.angular.z == 0.0 for command in chains.commands[count:])
    assert node.running
