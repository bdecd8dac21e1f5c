"""Requests to refinement: a common one, and the most expensive one."""

from __future__ import annotations

from chain_client import call

from ator_interfaces.msg import ObjectState
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import chain_of, pose_of, situation_of
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.world.state import ObjectState as Object
from ator_ros.world.state import RobotState, World


def short_request() -> RefineSubgoal.Request:
    """Return a request for the heading at the ball before a dribble."""
    request = RefineSubgoal.Request()
    request.situation.robot = pose_of(Pose(-2.0, 0.0, 0.0))
    request.situation.objects = [ObjectState(name="ball")]
    request.chain.calls = [
        call("goToBall", Pose(0.0, 0.0, 3.0), opened=("yaw",)),
        call("dribbleBall", Pose(0.5, 2.0, 1.5)),
    ]
    return request


def worst_request() -> RefineSubgoal.Request:
    """Return a request for all free variables of the longest chain."""
    library, calls = SOCCER.library(load_robot()), []
    for step in range(LONGEST_CHAIN):
        top = library["dribbleBall" if step % 2 else "goToBall"]
        goal = Goal(Pose(0.1 * ((step + 1) // 2), 0.0, 0.3), 0.0, top.point)
        calls.append(TopCall(top, goal, frozenset({EVERYTHING})))
    world = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), {"ball": Object(0.0, 0.0)})
    chain = TopChain(tuple(calls))
    return RefineSubgoal.Request(
        situation=situation_of(world, frame="odom"), chain=chain_of(chain, action_set="default", frame="odom")
    )
