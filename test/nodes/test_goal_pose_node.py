"""The `goal_pose` node with simulation and executor: RViz's 2D Goal Pose drives the robot."""

import time

import pytest
from chain_client import ChainClient
from geometry_msgs.msg import PoseStamped
from process import Process
from rclpy.publisher import Publisher
from ros_client import Client

from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import RESULTS

pytestmark = pytest.mark.long


@pytest.fixture
def node(start, client: Client) -> Process:
    """Return the node, with a simulation ten times as fast as real time."""
    start("simulation", real_time_factor=10.0, command_wait=0.5)
    start("executor", odom_timeout=1.5)
    chains = ChainClient(client)
    client.eventually(lambda: client.robots, "odometry")
    chains.wait_for_publishers()
    return start("goal_pose")


@pytest.fixture
def sender(node: Process, client: Client) -> Publisher:
    """Return a publisher of poses, once the node subscribes and has discovered the executor."""
    sender = client.node.create_publisher(PoseStamped, "goal_pose", RESULTS)
    client.eventually(sender.get_subscription_count, "a subscription to goal_pose")
    here = client.robot().pose

    def arrived() -> bool:
        sender.publish(PoseStamped(pose=pose_of(here)))
        time.sleep(1.0)
        return "arrived" in node.output

    client.eventually(arrived, "the executor's answer")
    return sender


def test_the_robot_drives_to_a_pose_and_other_frames_are_ignored(
    node: Process, sender: Publisher, client: Client
) -> None:
    message = PoseStamped(pose=pose_of(Pose(-1.0, 0.5, 1.0)))
    message.header.frame_id = "map"
    sender.publish(message)
    client.eventually(lambda: "expected the frame 'odom', got 'map'" in node.output, "a warning")
    message.header.frame_id = "odom"
    sender.publish(message)
    client.eventually(lambda: client.robot().pose.distance(Pose(-1.0, 0.5, 1.0)) < 0.06, "the robot")
