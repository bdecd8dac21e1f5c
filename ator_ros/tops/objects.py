"""The roles of objects in TOPs (needed, followed, held), read from their conditions."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.bases.description import Robot
from ator_ros.tops.chain import Top, TopCall
from ator_ros.tops.conditions import Condition, Statement, state_of
from ator_ros.world.state import World

# m beyond the length of the holder, from the hold, up to which an object counts as touched: the
# radius of a ball and the noise of its position
_TOUCHING = 0.08
# Ratio of the distance at which a held object is lost to that at which it is held: hysteresis, so
# that noise of a sixth of the holder's length does not change it.
_SLACK = 1.2


def objects_in(top: Top) -> list[str]:
    """Return the names of the objects in the conditions of a TOP, sorted."""
    return sorted(top.pre.objects() | top.post.objects())


def missing_object(top: Top, world: World) -> str | None:
    """Return the first object that a TOP needs and the world lacks; None if there is none."""
    for name in objects_in(top):
        if name not in world.objects:
            return name
    return None


def missing_in(calls: Iterable[TopCall], world: World) -> tuple[str, str] | None:
    """Return the first object that the world lacks, and the TOP that needs it.

    None if there is none.
    """
    for call in calls:
        if missing := missing_object(call.top, world):
            return missing, call.top.name
    return None


def held_first(top: Top) -> str | None:
    """Return the object that the robot holds when a TOP starts; None if there is none."""
    return _at(top.pre, "hold")


def held_last(top: Top) -> str | None:
    """Return the object that the robot holds when a TOP ends; None if there is none."""
    return _at(top.post, "hold")


def kept(top: Top) -> str | None:
    """Return the object that the robot holds when a TOP starts and when it ends.

    None if there is none.
    """
    return held_first(top) if held_first(top) == held_last(top) else None


def followed(top: Top) -> str | None:
    """Return the object that the pre-condition places at the goal, which moves with it.

    None if none.
    """
    return _at(top.pre, "goal")


def object_fetched_by(top: Top) -> str | None:
    """Return the object that a TOP drives to and then holds; None if there is none."""
    return followed(top) if followed(top) == held_last(top) else None


def _at(condition: Condition, place: str) -> str | None:
    """Return the first object, by name, that a condition places at `place`: both x and y."""
    related = {_pair(term) for term in condition.terms if term.is_at_target}
    for name in sorted(condition.objects()):
        if related >= _position_pairs(name, place):
            return name
    return None


def _pair(term: Statement) -> frozenset[str]:
    """Return both sides of a term as a set: "a near b" is the same as "b near a"."""
    return frozenset((term.variable, str(term.target)))


def _position_pairs(name: str, place: str) -> set[frozenset[str]]:
    return {frozenset((f"{name}.{axis}", f"{place}.{axis}")) for axis in "xy"}


def at_rest(world: World, robot: Robot) -> World:
    """Return the world with each object where it comes to rest if nothing is in its path."""
    objects = {name: robot.scene.at_rest(name, state) for name, state in world.objects.items()}
    return dataclasses.replace(world, objects=objects)


def has_left(
    world: World,
    call: TopCall,
    robot: Robot,
) -> bool:
    """Return whether the followed object is farther from the goal than the pre-condition allows."""
    name = followed(call.top)
    if name is None:
        return False
    state = state_of(world, robot)
    goal = goal_values(call.goal)
    pairs = _position_pairs(name, "goal")
    terms = [term for term in call.top.pre.terms if _pair(term) in pairs]
    return any(0.0 < term.excess(state, goal) < math.inf for term in terms)


def at_object(
    goal: Goal,
    world: World,
    name: str,
) -> Goal:
    """Return a goal with its position replaced by an object's.

    The same goal if the object is unknown.
    """
    there = world.objects.get(name)
    if there is None:
        return goal
    return dataclasses.replace(goal, pose=goal.pose._replace(x=there.x, y=there.y))


def held_within(robot: Robot) -> float:
    """Return the distance in m from the hold up to which an object counts as held.

    0 without a holder.
    """
    return robot.holder_length / _SLACK


def is_held(
    world: World,
    robot: Robot,
    name: str,
) -> bool:
    """Return whether the robot has a holder, and a known object lies in it."""
    return robot.holder is not None and robot.hold_offset(world, name) <= held_within(robot)


def is_lost(
    world: World,
    robot: Robot,
    name: str,
) -> bool:
    """Return whether the position of an object is known, and is too far from the hold."""
    return name in world.objects and robot.hold_offset(world, name) > robot.holder_length


def is_at_front(
    world: World,
    robot: Robot,
    name: str,
) -> bool:
    """Return whether the robot's front touches an object, or nearly: then the robot moves it."""
    return robot.hold_offset(world, name) < robot.holder_length + _TOUCHING
