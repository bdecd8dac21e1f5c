"""Situations, goals and chains as JSON: what passes between a node and the process that plans for it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from ator_ros.actions.base import Goal
from ator_ros.geometry import Pose
from ator_ros.planning.wanted import Unspecified, Wish
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.conditions import Region, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World

Json = dict[str, Any]
_KINDS = {kind.__name__: kind for kind in (Term, Region, Unspecified)}


def asked(wishes: Sequence[Wish], world: World, action_set: str) -> Json:
    """Return a request for chains as JSON."""
    robot = world.robot
    return {
        "action_set": action_set,
        "wishes": [{"kind": type(wish).__name__, **dataclasses.asdict(wish)} for wish in wishes],
        "robot": [*robot.pose, robot.v, robot.w],
        "objects": {name: dataclasses.astuple(there) for name, there in world.objects.items()},
    }


def read(request: Json) -> tuple[list[Wish], World]:
    """Return the goal and the situation of a request."""
    wishes = [
        _KINDS[wish["kind"]](**{name: value for name, value in wish.items() if name != "kind"})
        for wish in request["wishes"]
    ]
    x, y, yaw, v, w = request["robot"]
    objects = {name: ObjectState(*there) for name, there in request["objects"].items()}
    return wishes, World(0.0, RobotState(Pose(x, y, yaw), v, w), objects)


def written(chain: TopChain) -> list[Json]:
    """Return a chain as JSON."""
    return [
        {
            "top": call.top.name,
            "pose": list(call.goal.pose),
            "speed": call.goal.speed,
            "values": dict(call.goal.values),
            "open": sorted(call.open),
        }
        for call in chain.calls
    ]


def chain_from(calls: Sequence[Json], library: TopLibrary) -> TopChain:
    """Return the chain that was written."""
    return TopChain(tuple(_call_from(call, library) for call in calls))


def _call_from(call: Json, library: TopLibrary) -> TopCall:
    top = library[call["top"]]
    goal = Goal(Pose(*call["pose"]), call["speed"], top.point, call["values"])
    return TopCall(top, goal, frozenset(call["open"]))
