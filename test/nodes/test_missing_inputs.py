"""Reports of missing inputs in the result, the log and the diagnostics."""

from collections.abc import Callable
from functools import partial

import pytest
from chain_client import ChainClient, call
from conftest import Host
from geometry_msgs.msg import PoseStamped, Twist
from moving_base import MovingBase
from nav_msgs.msg import Odometry
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import NEWEST

AWAY = [call("goToPose", Pose(2.0, 0.0, 0.0))]
TO_BALL = [call("goToBall", Pose(0.0, 0.0, 0.0))]
CLIENT = {"silent": True}


def another_type(client: Client) -> None:
    client.node.create_publisher(PoseStamped, "odom", NEWEST)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (
            partial(MovingBase, odom="wheels/odom"),
            "of type nav_msgs/Odometry there is /wheels/odom: remap with -r odom:=/wheels/odom",
        ),
        (
            another_type,
            "odom: expected nav_msgs/Odometry, /test_client publishes geometry_msgs/PoseStamped",
        ),
        (
            partial(MovingBase, frame="ann/odom"),
            "expected the frame 'odom', got 'ann/odom'; set frame:=ann/odom",
        ),
    ],
)
def test_missing_odometry(
    host: Host, client: Client, fault: Callable[[Client], None], expected: str
) -> None:
    node = host("executor", start_timeout=1.0)
    health = client.statuses()
    fault(client)
    outcome = ChainClient(client).send(AWAY).outcome()
    assert outcome.code == Outcome.INPUT_LOST
    assert outcome.reason.startswith(
        "odom is missing: expected one within 1 s of the goal, got none; "
    )
    assert expected in outcome.reason
    assert expected in node.output
    client.eventually(lambda: expected in health[-1].message, "diagnostics")


def test_an_object_with_stamps_of_another_clock_is_reported(host: Host, client: Client) -> None:
    host("executor", start_timeout=4.0)
    MovingBase(client)
    ball = client.node.create_publisher(Odometry, "ball", NEWEST)
    message = Odometry()
    message.header.stamp = client.node.get_clock().now().to_msg()
    message.pose.pose.position.x, message.pose.pose.orientation.w = 1.0, 1.0
    client.node.create_timer(0.05, lambda: ball.publish(message))
    outcome = ChainClient(client).send(TO_BALL).outcome()
    assert outcome.code == Outcome.INPUT_LOST
    assert (
        "messages of /test_client are ignored: ball.header.stamp: expected about " in outcome.reason
    )


def test_a_goal_succeeds_though_odometry_is_slower_than_real_time(
    host: Host, client: Client
) -> None:
    host("executor")
    base = MovingBase(client)
    base.set_pace(0.2)
    chains = ChainClient(client)
    outcome = chains.send([call("goToPose", Pose(0.4, 0.0, 0.0))]).result(60.0).outcome
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason


def test_a_robot_that_moves_when_odometry_returns_is_stopped(host: Host, client: Client) -> None:
    host("executor")
    base = MovingBase(client)
    sent = ChainClient(client).send(AWAY)
    client.eventually(lambda: base.commanded.linear.x > 0.2, "the robot drives")
    base.timer.cancel()
    assert sent.outcome().code == Outcome.INPUT_LOST
    base.commanded = Twist()
    base.commanded.linear.x = 0.5  # it has kept driving
    base.timer.reset()
    client.eventually(lambda: base.commanded.linear.x == 0.0, "a command to stop")
