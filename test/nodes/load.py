"""Requests to refinement, an ordinary one and the most expensive; as a program, a flood of the latter.

scripts/run python test/nodes/load.py 500
"""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.node import Node

from ator_interfaces.msg import TopCall
from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.conversions import pose_of
from ator_ros.refinement.refiner import LONGEST_CHAIN

EVERYTHING = ("*",)


def call(top: str, pose: Pose, opened: tuple[str, ...]) -> TopCall:
    """Give a step in which `opened` is left to refinement."""
    message = TopCall(top=top, open=list(opened))
    message.goal.pose = pose_of(pose)
    return message


def short_request() -> RefineSubgoal.Request:
    """Ask for the heading at the ball before a dribble."""
    request = RefineSubgoal.Request()
    request.situation.robot = pose_of(Pose(-2.0, 0.0, 0.0))
    request.situation.ball_known = True
    request.chain.calls = [
        call("goToBall", Pose(0.0, 0.0, 3.0), ("yaw",)),
        call("dribbleBall", Pose(0.5, 2.0, 1.5), ()),
    ]
    return request


def heavy_request() -> RefineSubgoal.Request:
    """Ask for all that may be free in the longest chain."""
    request = short_request()
    tops = ["goToBall", "dribbleBall"] * (LONGEST_CHAIN // 2)
    request.chain.calls = [
        call(top, Pose(0.1 * ((i + 1) // 2), 0.0, 0.3), EVERYTHING) for i, top in enumerate(tops)
    ]
    return request


def main() -> None:
    """Send the number of requests that the command line names, fetch no answer, and wait to be killed."""
    rclpy.init()
    client = Node("flood").create_client(RefineSubgoal, "refine_subgoal")
    client.wait_for_service(timeout_sec=40.0)
    for _ in range(int(sys.argv[1])):
        client.call_async(heavy_request())
    time.sleep(3600.0)


if __name__ == "__main__":
    main()
