"""The executor accepts odometry as real bases publish it, and stops without usable odometry."""

import math
import re
from collections.abc import Callable

import pytest
from chain_client import ChainClient, call
from conftest import Host
from moving_base import PERIOD, MovingBase
from nav_msgs.msg import Odometry
from ros_client import Client

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import odometry_of
from ator_ros.nodes.qos import NEWEST
from ator_ros.world.state import RobotState

Quirk = Callable[[Odometry, float], None]
"""Changes an odometry message of a robot with this heading (rad)."""
SETTINGS = {
    "frame": "/odom",
    "odom_timeout": 1.0,
    "start_timeout": 2.0,
    "fence": "[-1e7, -1e7, 1e7, 1e7]",
}


class QuirkyBase(MovingBase):
    """A base that publishes `rate` odometry messages per second, each changed by `quirk`.

    After every `late` messages, one is published after its successor; 0: none.
    """

    def __init__(self, client: Client) -> None:
        self.quirk: Quirk = plain
        self.late = self._count = 0
        self.rate = round(1.0 / PERIOD)
        self._held: Odometry | None = None
        super().__init__(client)

    def publish(self, state: RobotState) -> None:
        message = odometry_of(self.time, state, frame="odom", child="base_link")
        self.quirk(message, self.pose.yaw)
        self._count += 1
        if self._count % round(1.0 / PERIOD / self.rate):
            return
        if self.late and self._count % self.late == 0:
            self._held = message
            return
        self._odom.publish(message)
        if self._held is not None:
            self._odom.publish(self._held)
            self._held = None


def plain(message: Odometry, yaw: float) -> None:
    """Change nothing."""


def foreign(message: Odometry, yaw: float) -> None:
    """Change the frame's name, the clock, and the length of the quaternion."""
    message.header.frame_id = "/odom"
    message.header.stamp.sec += 1_764_000_000
    turn = message.pose.pose.orientation
    turn.z, turn.w = 1.3 * turn.z, 1.3 * turn.w


def twist_in_odom(message: Odometry, yaw: float) -> None:
    linear = message.twist.twist.linear
    message.child_frame_id = message.header.frame_id
    linear.x, linear.y = linear.x * math.cos(yaw), linear.x * math.sin(yaw)


def unsigned_twist(message: Odometry, yaw: float) -> None:
    message.twist.twist.linear.x = abs(message.twist.twist.linear.x)


def twist_in_millimeters(message: Odometry, yaw: float) -> None:
    message.twist.twist.linear.x *= 1000.0


def no_direction(message: Odometry, yaw: float) -> None:
    turn = message.pose.pose.orientation
    turn.z = turn.w = 0.0


CLIENT = {"silent": True}
FAR = Pose(691_608.25, 5_334_761.5, 2.2)


@pytest.fixture
def base(client: Client) -> QuirkyBase:
    return QuirkyBase(client)


@pytest.mark.long
@pytest.mark.parametrize("quirk", [foreign, twist_in_odom])
def test_odometry_with_a_quirk_drives_the_robot_to_its_goal(
    host: Host, client: Client, base: QuirkyBase, quirk: Quirk
) -> None:
    base.quirk, base.late = quirk, 10
    base.pose = FAR
    node = host("executor", **SETTINGS)
    goal = FAR.compose(Pose(0.7, 0.4, 0.8))
    result = ChainClient(client).send([call("goToPose", goal)]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert base.pose.distance(goal) < 0.05
    assert "contradict" not in node.output


@pytest.mark.long
def test_an_unsigned_twist_drives_the_robot_to_a_goal_behind_it(
    host: Host, client: Client, base: QuirkyBase
) -> None:
    base.quirk = unsigned_twist
    node = host("executor", **SETTINGS)
    goals = [Pose(-1.5, 0.0, 0.0), Pose(0.5, 0.0, 0.0)]
    result = ChainClient(client).send([call("goToPose", goal) for goal in goals]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert base.pose.distance(goals[1]) < 0.05
    assert "pose and twist.linear contradict each other" in node.output


@pytest.mark.long
def test_a_twist_in_millimeters_drives_the_robot_to_its_goal_and_is_named(
    host: Host, client: Client, base: QuirkyBase
) -> None:
    base.quirk = twist_in_millimeters
    node = host("executor", **(SETTINGS | {"fence": "[-1.0, -1.0, 3.0, 2.0]"}))
    goal = Pose(1.5, 0.5, 0.5)
    result = ChainClient(client).send([call("goToPose", goal)]).result()
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert base.pose.distance(goal) < 0.05
    assert "it looks like mm/s: publish m/s" in node.output


def test_two_senders_of_odometry_are_named_whatever_ends_the_goal(
    host: Host, client: Client, base: QuirkyBase
) -> None:
    other = client.node.create_publisher(Odometry, "odom", NEWEST)

    def publish_elsewhere() -> None:
        state = base.state()
        pose = base.pose._replace(y=base.pose.y + 0.3)
        shifted = RobotState(pose, state.vx, state.w)
        other.publish(odometry_of(base.time + 0.02, shifted, frame="odom", child="base_link"))

    client.node.create_timer(PERIOD, publish_elsewhere)
    reports = client.statuses()
    host("executor", **SETTINGS)
    outcome = ChainClient(client).send([call("goToPose", Pose(2.0, 0.0, 0.0))]).outcome()
    assert outcome.code != Outcome.REFUSED, outcome.reason
    named = "odom: expected one publisher, got 2"
    if outcome.code != Outcome.SUCCEEDED:  # it may read the messages of one node only
        assert named in outcome.reason or "jump to and fro by 0.3" in outcome.reason
    client.eventually(lambda: any(named in report.message for report in reports), "diagnostics")


def test_odometry_at_5_hz_is_reported_with_the_remedy(
    host: Host, client: Client, base: QuirkyBase
) -> None:
    base.rate = 5
    host("executor", **(SETTINGS | {"odom_timeout": 0.3, "action_timeout": 4.0}))
    outcome = ChainClient(client).send([call("goToPose", base.pose.ahead(30.0))]).outcome()
    assert outcome.code == Outcome.FAILED, outcome.reason
    assert re.search(r"odom: messages came 0\.(1[5-9]|2\d?) s apart", outcome.reason), (
        outcome.reason
    )
    assert "set odom_timeout:=" in outcome.reason


def test_odometry_without_orientation_is_reported_and_stops_the_robot(
    host: Host, client: Client, base: QuirkyBase
) -> None:
    node = host("executor", **SETTINGS)
    sent = ChainClient(client).send([call("goToPose", base.pose.ahead(3.0))])
    client.eventually(lambda: sent.ended() or base.state().vx > 0.3, "the robot drives")
    base.quirk = no_direction
    outcome = sent.outcome()
    assert outcome.code == Outcome.INPUT_LOST, outcome.reason
    client.eventually(lambda: base.state() == RobotState(base.pose), "the robot stands")
    assert "ignored: odom.pose.pose.orientation: expected a quaternion" in node.output
