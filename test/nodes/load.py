"""An ordinary request to refinement; as a program, a flood of the most expensive ones.

scripts/run python test/nodes/load.py 500
"""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.node import Node

from ator_interfaces.msg import ObjectState, TopCall
from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.tools.benchmarks.requests import worst_request


def call(top: str, pose: Pose, opened: tuple[str, ...]) -> TopCall:
    """Return a step in which `opened` is left to refinement."""
    message = TopCall(top=top, open=list(opened))
    message.goal.pose = pose_of(pose)
    return message


def short_request() -> RefineSubgoal.Request:
    """Return a request for the heading at the ball before a dribble."""
    request = RefineSubgoal.Request()
    request.situation.robot = pose_of(Pose(-2.0, 0.0, 0.0))
    request.situation.objects = [ObjectState(name="ball")]
    request.chain.calls = [
        call("goToBall", Pose(0.0, 0.0, 3.0), ("yaw",)),
        call("dribbleBall", Pose(0.5, 2.0, 1.5), ()),
    ]
    return request


def main() -> None:
    """Send the number of requests that the command line names, fetch no answer, and wait to be killed."""
    rclpy.init()
    client = Node("flood").create_client(RefineSubgoal, "refine_subgoal")
    client.wait_for_service(timeout_sec=40.0)
    for _ in range(int(sys.argv[1])):
        client.call_async(worst_request())
    time.sleep(3600.0)


if __name__ == "__main__":
    main()
