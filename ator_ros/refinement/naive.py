"""Naive values of a chain's open variables without models, for when there is no time to search."""

from __future__ import annotations

import math

import numpy as np

from ator_ros.actions.goal_variables import STOP, with_values
from ator_ros.bases.description import Robot
from ator_ros.bases.routes import arrival_heading
from ator_ros.geometry import Pose
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import TopCall, TopChain, projected
from ator_ros.tops.ranges import Ranges
from ator_ros.world.state import World

_AT_GOAL = 0.01  # m up to which a robot is at its goal, and arrives there in its present heading


def naive_on_paths(
    world: World,
    chain: TopChain,
    robot: Robot,
    ranges: Ranges,
) -> TopChain:
    """Return `chain` with open headings in which the robot comes along a straight line or route.

    Where such a heading is not allowed, the nearest allowed one takes its place.

    These are the fastest headings of a path that turns, drives and turns, for each action alone.
    Open variables with a rest value (arrival speed: 0) take it. `STOP` and the others keep their
    values, and so do all variables of a step for which its naive values would make the plan
    invalid.

    Parameters
    ----------
    world : World
        The state from which the chain starts.
    chain : TopChain
        The plan; the values of its open variables are placeholders.
    ranges : mapping of str
        Goal variable to its range; variables without one keep their values.
    """
    if not any(call.open for call in chain.calls):
        return chain
    bound = bindings(tuple(call.top for call in chain.calls))
    naive = chain
    valid = not chain.violations(world, robot)
    for index in range(len(chain.calls)):
        call = naive.calls[index]
        opened = {
            name: domain
            for name in ranges
            if call.opens(name)
            and (index, name) not in bound
            and (domain := call.range_of(name, robot, ranges)) is not None
            and name != STOP
        }
        values = {name: domain.rest for name, domain in opened.items() if domain.rest is not None}
        if "yaw" in opened and "yaw" not in values:
            arrival = np.array([_arrival(world.robot.pose, call, robot)])
            values["yaw"] = float(opened["yaw"].nearest(arrival)[0])
        changed = with_values(call.goal, values) if values else call.goal
        if changed != call.goal:
            candidate = naive.with_goal(index, changed)
            affected = _affected_part(world, naive, candidate, index, robot)
            if not (valid and affected.violations(world, robot)):
                naive = candidate
        world = projected(world, naive.calls[index], robot)
    return naive


def _affected_part(
    world: World, chain: TopChain, changed: TopChain, index: int, robot: Robot
) -> TopChain:
    """Return the steps of `changed` whose start or goal differs, all from `index` (from 0) on.

    The step at `index` starts in `world`.
    """
    before = after = world
    for step in range(index, len(chain)):
        before = projected(before, chain.calls[step], robot)
        after = projected(after, changed.calls[step], robot)
        if before == after and not changed.calls[step].passing:
            return changed.part(index, step + 1)
    return changed.part(index)


def _arrival(
    start: Pose,
    call: TopCall,
    robot: Robot,
) -> float:
    """Return the heading in rad in which the robot comes from `start` to the goal of a step."""
    goal = call.goal.pose
    if math.hypot(goal.x - start.x, goal.y - start.y) <= _AT_GOAL:
        return start.yaw
    return arrival_heading((start.x, start.y), goal, robot)
