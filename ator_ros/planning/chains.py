"""Chains from plans: each step with a goal, in which all that the plan does not determine is open.

Values of open variables are placeholders, which refinement replaces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import with_values
from ator_ros.execution.fence import Fence
from ator_ros.geometry import FloatArray, Pose
from ator_ros.planning.facts import Fact, placed_thing, resolved
from ator_ros.planning.goals import PlanningError
from ator_ros.planning.problem import PlannedStep
from ator_ros.tops.chain import Top, TopCall, TopChain, projected
from ator_ros.tops.conditions import State, state_of
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import World

_SPACING, _MOST_INTERVALS = 0.1, 400
"""Grid of candidate places: spacing in m, and greatest number of intervals along a side of the area."""
_LEAST_DISTANCE = 0.5
"""Preferred least distance in m of a place from the present one."""


def chain_of(steps: Sequence[PlannedStep], world: World, library: TopLibrary, fence: Fence) -> TopChain:
    """Return the chain of a plan's steps, with places inside the scene's area and the fence.

    Raises
    ------
    PlanningError
        There is no place for a step.
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
        found = _place_in(step.region, step.top, state, edges)
        if found is None:
            raise PlanningError(f"{step.top.name}: expected a place for it in the area, found none")
        place = {"x": found[0], "y": found[1]}
    yaw = _heading(step, Pose(place["x"], place["y"], 0.0), world)
    return TopCall(
        step.top, with_values(goal, {"yaw": yaw, **known, **place}), _opened(step, goal, last=last)
    )


def _heading(step: PlannedStep, place: Pose, world: World) -> float:
    """Return the heading at a place: toward the target of the next action, else along the approach."""
    at = world.robot.pose
    if step.region:
        target = dict(step.region[0].binding)
        x, y = target.get("x"), target.get("y")
        if isinstance(x, float) and isinstance(y, float) and (x, y) != (place.x, place.y):
            return math.atan2(y - place.y, x - place.x)
    distance = math.hypot(place.x - at.x, place.y - at.y)
    return math.atan2(place.y - at.y, place.x - at.x) if distance > 0.0 else at.yaw


def _opened(step: PlannedStep, goal: Goal, *, last: bool) -> frozenset[str]:
    """Return the open goal variables."""
    bound = frozenset() if step.region else frozenset(name for name, _ in step.binding)
    place = {"x", "y", "yaw"} if step.top.arrives else set[str]()
    speed = {"speed"} if step.top.arrives and not last else set[str]()
    return frozenset(place | speed | goal.values.keys()) - bound


def _place_in(
    region: Sequence[Fact], top: Top, state: State, edges: tuple[float, float, float, float]
) -> tuple[float, float] | None:
    """Return the place (m) in a region that is nearest to the present place of its thing, or None.

    It keeps the tolerance of the TOP that brings the thing there from the edge, if possible, and lies within
    the `edges` x_min, y_min, x_max, y_max (m).
    """
    thing = placed_thing(region[0].clause)
    goal = resolved(dict(region[0].binding), state)
    places = _candidates(edges, goal)
    there = {**state, f"{thing}.x": places[:, 0], f"{thing}.y": places[:, 1]}
    margins = [fact.clause.clearance(there, resolved(dict(fact.binding), state)) for fact in region]
    least = np.min([-np.inf if margin is None else margin for margin in margins], axis=0)
    for margin in (top.place_tolerance, 0.0):
        good = places[np.broadcast_to(least >= margin - 1e-9, len(places))]
        if len(good):
            away = np.hypot(
                good[:, 0] - state.get(f"{thing}.x", 0.0), good[:, 1] - state.get(f"{thing}.y", 0.0)
            )
            far = away >= _LEAST_DISTANCE
            index = int(np.argmin(np.where(far, away, np.inf)) if far.any() else np.argmax(away))
            return float(good[index, 0]), float(good[index, 1])
    return None


def _candidates(edges: tuple[float, float, float, float], goal: Mapping[str, float]) -> FloatArray:
    """Return places inside the edges, shape (n, 2), and the goal itself."""
    x_min, y_min, x_max, y_max = edges
    spacing = max(_SPACING, (x_max - x_min) / _MOST_INTERVALS, (y_max - y_min) / _MOST_INTERVALS)
    xs = np.arange(x_min, x_max + spacing / 2, spacing)
    ys = np.arange(y_min, y_max + spacing / 2, spacing)
    grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    return np.vstack([grid, [goal.get("x", 0.0), goal.get("y", 0.0)]])
