"""Requests to refinement that load the node: the most expensive one that is a valid plan."""

from __future__ import annotations

from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.base import Goal
from ator_ros.evaluation.toolset import ToolsetSource, make_library
from ator_ros.geometry import Pose
from ator_ros.nodes import messages
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import fetched, kept
from ator_ros.world.state import ObjectState, RobotState, World

_FRAME = "odom"
_SHIPPED = ToolsetSource()


def worst_request(source: ToolsetSource = _SHIPPED) -> RefineSubgoal.Request:
    """Return a request for everything that may be free in the longest chain."""
    world, chain = long_chain(make_library(source.described(), source), LONGEST_CHAIN)
    return RefineSubgoal.Request(
        situation=messages.situation_of(world, frame=_FRAME),
        chain=messages.chain_of(chain, action_set=source.action_set, frame=_FRAME),
    )


def long_chain(library: TopLibrary, steps: int) -> tuple[World, TopChain]:
    """Return an object that is fetched and carried on, an even number of `steps`, and the world before."""
    fetching = next(top for top in library.usable() if fetched(top))
    carrying = next(top for top in library.usable() if kept(top))
    tops = [fetching, carrying] * (steps // 2)
    places = [Pose(0.1 * ((step + 1) // 2), 0.0, 0.3) for step in range(steps)]
    calls = [
        TopCall(top, Goal(place, 0.0, top.point), frozenset({EVERYTHING}))
        for top, place in zip(tops, places, strict=True)
    ]
    there = {str(fetched(fetching)): ObjectState(0.0, 0.0)}
    return World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), there), TopChain(tuple(calls))
