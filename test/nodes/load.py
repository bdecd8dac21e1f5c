"""An ordinary request to refinement; as a program, a flood of the most expensive ones.

scripts/run python test/nodes/load.py 500
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import rclpy
from rclpy.node import Node

from ator_interfaces.msg import ObjectState, TopCall
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import chain_of, pose_of, situation_of
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import EVERYTHING, TopChain
from ator_ros.tops.chain import TopCall as Step
from ator_ros.world.state import ObjectState as Object
from ator_ros.world.state import RobotState, World


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


LIMIT_DELAY_MS = 20.0
"""By how much requests may be delayed by others."""


def worst_request() -> RefineSubgoal.Request:
    """Return a request for everything that may be free in the longest chain."""
    library, calls = SOCCER.library(load_robot()), []
    for step in range(LONGEST_CHAIN):
        top = library["dribbleBall" if step % 2 else "goToBall"]
        goal = Goal(Pose(0.1 * ((step + 1) // 2), 0.0, 0.3), 0.0, top.point)
        calls.append(Step(top, goal, frozenset({EVERYTHING})))
    world = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), {"ball": Object(0.0, 0.0)})
    chain = TopChain(tuple(calls))
    return RefineSubgoal.Request(
        situation=situation_of(world, frame="odom"), chain=chain_of(chain, action_set="default", frame="odom")
    )


def resident_mib(pid: int) -> float:
    """Return the resident memory of a process in MiB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


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
