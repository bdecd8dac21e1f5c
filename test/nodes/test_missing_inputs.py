"""Reports of missing inputs in the result, the log and the diagnostics."""

import math
import time
from collections import deque
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
from ator_ros.nodes.messages import odometry_of
from ator_ros.nodes.qos import NEWEST
from ator_ros.world.state import RobotState

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


@pytest.mark.long
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


@pytest.mark.long
def test_a_goal_succeeds_though_odometry_is_slower_than_real_time(
    host: Host, client: Client
) -> None:
    host("executor")
    base = MovingBase(client)
    base.set_pace(0.2)
    chains = ChainClient(client)
    outcome = chains.send([call("goToPose", Pose(0.2, 0.0, 0.0))]).result(60.0).outcome
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


@pytest.mark.long
def test_a_base_that_stalls_while_nodes_start_does_not_end_the_goal(
    host: Host, client: Client
) -> None:
    base = MovingBase(client)
    host("executor")
    sent = ChainClient(client).send(AWAY)
    client.eventually(lambda: sent.ended() or base.pose.x > 0.1, "the robot drives")
    client.within(base.timer.cancel)
    time.sleep(0.8)  # the default of odom_timeout is 0.3 s
    client.within(base.timer.reset)
    outcome = sent.outcome()
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason


class DelayedBase(MovingBase):
    """A base whose odometry is delayed by 0.3 s more in each second since `begin`, up to 2 s.

    Its stamps are real time in s.
    """

    def __init__(self, client: Client) -> None:
        self.begin = math.inf
        self._waiting: deque[tuple[float, RobotState]] = deque()
        super().__init__(client)

    def publish(self, state: RobotState) -> None:
        now = time.monotonic()
        self._waiting.append((now, state))
        delay = min(0.3 * max(0.0, now - self.begin), 2.0)
        while self._waiting and self._waiting[0][0] <= now - delay:
            stamp, late = self._waiting.popleft()
            self._odom.publish(odometry_of(stamp, late, frame=self.frame, child="base_link"))


def test_odometry_whose_delay_grows_ends_the_goal(host: Host, client: Client) -> None:
    base = DelayedBase(client)
    node = host("executor", fence="[-9.0, -3.0, 9.0, 3.0]")
    health = client.statuses()

    def delay() -> str:
        values = {item.key: item.value for item in health[-1].values} if health else {}
        return values.get("delay of odom (s)", "unknown")

    client.eventually(lambda: delay() != "unknown", "the clock's usual delay")
    sent = ChainClient(client).send([call("goToPose", Pose(4.0, 0.0, 0.0))])
    client.eventually(lambda: sent.ended() or base.pose.x > 0.3, "the robot drives")
    base.begin = time.monotonic()
    outcome = sent.outcome()
    assert outcome.code == Outcome.INPUT_LOST, outcome.reason
    assert "odom is late: expected states that are at most 0.3 s old" in outcome.reason
    assert "odom is late" in node.output
    assert base.pose.x < 3.0
    client.eventually(lambda: base.state() == RobotState(base.pose), "the robot stands")
