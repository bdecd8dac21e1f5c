"""Chains from plans: each step with a goal, and open what the plan does not determine."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import with_values
from ator_ros.execution.fence import Fence
from ator_ros.geometry import Pose
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.facts import resolved
from ator_ros.planning.operators import PlannedStep
from ator_ros.planning.placing import place_in
from ator_ros.tops.chain import TopCall, TopChain, projected
from ator_ros.tops.conditions import state_of
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World


def chain_of(steps: Sequence[PlannedStep], world: World, library: TopLibrary, fence: Fence) -> TopChain:
    """Return the chain of a plan's steps, with places inside the scene's area and the fence.

    Raises
    ------
    PlanningError
        There is no place that a step needs.
    """
    calls: list[TopCall] = []
    for number, step in enumerate(steps, start=1):
        call = _call(step, world, library, fence, last=number == len(steps))
        calls.append(call)
        world = projected(world, call, library.robot)
    return TopChain(tuple(calls))


def _call(step: PlannedStep, world: World, library: TopLibrary, fence: Fence, *, last: bool) -> TopCall:
    robot, state = library.robot, state_of(world, library.robot)
    known = resolved(dict(step.binding), state)
    goal = library.goal(step.top, world.robot.pose)
    at = robot.hold_point(world.robot.pose) if step.top.point is Point.HOLD else world.robot.pose
    place = {"x": at.x, "y": at.y, **{name: known[name] for name in "xy" if name in known}}
    if step.region:
        edges = fence.part_of(robot.scene.area.lines, robot, step.top.point)
        found = place_in(step.region, step.top, state, edges)
        if found is None:
            raise PlanningError(f"{step.top.name}: expected a place for it in the area, found none")
        place = {"x": found[0], "y": found[1]}
    yaw = _heading(step, Pose(place["x"], place["y"], 0.0), world)
    values = {"yaw": yaw, **known, **place}
    return TopCall(step.top, with_values(goal, values), _opened(step, goal, last=last))


def _heading(step: PlannedStep, place: Pose, world: World) -> float:
    """Return where the robot looks at a place: to what the place is for, or on in its direction."""
    at = world.robot.pose
    if step.region:
        target = dict(step.region[0].binding)
        x, y = target.get("x"), target.get("y")
        if isinstance(x, float) and isinstance(y, float) and (x, y) != (place.x, place.y):
            return math.atan2(y - place.y, x - place.x)
    way = math.hypot(place.x - at.x, place.y - at.y)
    return math.atan2(place.y - at.y, place.x - at.x) if way > 0.0 else at.yaw


def _opened(step: PlannedStep, goal: Goal, *, last: bool) -> frozenset[str]:
    """Return the goal variables that the plan leaves to refinement."""
    bound = frozenset() if step.region else frozenset(name for name, _ in step.binding)
    place = {"x", "y", "yaw"} if step.top.arrives else set[str]()
    speed = {"speed"} if step.top.arrives and not last else set[str]()
    return frozenset(place | speed | goal.values.keys()) - bound
