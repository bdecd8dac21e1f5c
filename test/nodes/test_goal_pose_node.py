"""The `goal_pose` node with simulation and executor: RViz's 2D Goal Pose drives the robot."""

import time

import pytest
from arena import LONG_START
from chain_client import ChainClient
from conftest import Start
from geometry_msgs.msg import PoseStamped
from ros_client import Client

from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import RESULTS

pytestmark = pytest.mark.long


def test_the_robot_drives_to_a_pose_and_other_frames_are_ignored(
    start: Start, client: Client
) -> None:
    start("simulation", real_time_factor=10.0, command_wait=0.5)
    executor = start("executor", odom_timeout=1.5)
    client.eventually(lambda: "ready for chains" in executor.output, "the executor", LONG_START)
    here = client.robot().pose
    ChainClient(client).wait_for_publishers()
    node = start("goal_pose")
    sender = client.node.create_publisher(PoseStamped, "goal_pose", RESULTS)
    client.eventually(sender.get_subscription_count, "a subscription to goal_pose")

    def arrived() -> bool:  # the node discovers the executor later than the test does
        sender.publish(PoseStamped(pose=pose_of(here)))
        time.sleep(1.0)
        return "arrived" in node.output

    client.eventually(arrived, "the executor's answer")
    message = PoseStamped(pose=pose_of(Pose(-1.0, 0.5, 1.0)))
    message.header.frame_id = "map"
    sender.publish(message)
    client.eventually(lambda: "expected the frame 'odom', got 'map'" in node.output, "a warning")
    message.header.frame_id = "odom"
    sender.publish(message)
    client.eventually(
        lambda: client.robot().pose.distance(Pose(-1.0, 0.5, 1.0)) < 0.06, "the robot"
    )


def test_the_robot_stops_where_its_client_is_killed(start: Start, client: Client) -> None:
    start("simulation", real_time_factor=0.2)  # the drive takes 30 s
    executor = start("executor", odom_timeout=1.5, action_timeout=600.0)
    client.eventually(lambda: "ready for chains" in executor.output, "the executor", LONG_START)
    node, chains = start("goal_pose"), ChainClient(client)
    chains.wait_for_publishers()
    sender = client.node.create_publisher(PoseStamped, "goal_pose", RESULTS)
    client.eventually(sender.get_subscription_count, "a subscription to goal_pose")
    target = Pose(2.5, 1.5, 0.0)

    def drives() -> bool:
        sender.publish(PoseStamped(pose=pose_of(target)))
        time.sleep(8.0)  # a newer goal would start again
        return client.robot().vx > 0.1

    client.eventually(drives, "the robot drives")
    node.kill()
    client.eventually(
        lambda: any("client of this goal is gone" in each.outcome.reason for each in chains.chains),
        "the end of the goal",
    )
    client.eventually(chains.standing, "the robot stands")
    assert client.robot().pose.distance(target) > 1.0
