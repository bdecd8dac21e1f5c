"""Requests to refinement that load the node: the most expensive one that is a valid plan."""

from __future__ import annotations

from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes import conversions
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

_FRAME = "odom"


def worst_request() -> RefineSubgoal.Request:
    """Return a request for everything that may be free in the longest chain."""
    world, chain = long_chain(SOCCER.library(load_robot()), LONGEST_CHAIN)
    return RefineSubgoal.Request(
        situation=conversions.situation_of(world, frame=_FRAME),
        chain=conversions.chain_of(chain, action_set="", frame=_FRAME),
    )


def long_chain(library: TopLibrary, steps: int) -> tuple[World, TopChain]:
    """Return a ball that is fetched and carried on, an even number of `steps`, and the world before."""
    tops = [library[top] for top in ["goToBall", "dribbleBall"] * (steps // 2)]
    places = [Pose(0.1 * ((step + 1) // 2), 0.0, 0.3) for step in range(steps)]
    calls = [
        TopCall(top, Goal(place, 0.0, top.point), frozenset({EVERYTHING}))
        for top, place in zip(tops, places, strict=True)
    ]
    world = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), {BALL: ObjectState(0.0, 0.0)})
    return world, TopChain(tuple(calls))
