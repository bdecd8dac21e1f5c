"""Objects in TOPs: which are needed, followed, held, all read from the conditions."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from ator_ros.actions.base import Goal
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopCall
from ator_ros.tops.conditions import Condition
from ator_ros.tops.state import goal_variables, state_of
from ator_ros.tops.top import Top
from ator_ros.world.state import World

_TOUCHING = 0.08
_ROOM = 0.06
_LOST = 0.12


def objects_in(top: Top) -> list[str]:
    """Return the names of the objects that the conditions of a TOP speak of, sorted."""
    return sorted(top.pre.objects() | top.post.objects())


def missing_object(top: Top, world: World) -> str | None:
    """Return the first object that a TOP needs and that is not known; None where all are."""
    return next((name for name in objects_in(top) if name not in world.objects), None)


def missing_in(calls: Iterable[TopCall], world: World) -> tuple[str, str] | None:
    """Return the first object that is not known and the TOP that needs it; None where all are known."""
    pairs = ((missing_object(call.top, world), call.top.name) for call in calls)
    return next(((name, top) for name, top in pairs if name is not None), None)


def held_first(top: Top) -> str | None:
    """Return the object with which in front of the robot a TOP starts."""
    return _held(top.pre)


def held_last(top: Top) -> str | None:
    """Return the object with which in front of the robot a TOP ends."""
    return _held(top.post)


def kept(top: Top) -> str | None:
    """Return the object that a TOP has in front of the robot at its start and at its end."""
    return held_first(top) if held_first(top) == held_last(top) else None


def followed(top: Top) -> str | None:
    """Return the object at which a TOP's goal lies, so that it moves when the object does."""
    return _related(top.pre, "goal")


def fetched(top: Top) -> str | None:
    """Return the object that a TOP drives to, and ends with in front of the robot."""
    return followed(top) if followed(top) == held_last(top) else None


def _held(condition: Condition) -> str | None:
    return _related(condition, "hold")


def _related(condition: Condition, other: str) -> str | None:
    """Return the object whose position is near `other`'s by a condition, the first in order of names."""
    said = {frozenset((term.variable, str(term.target))) for term in condition.terms}
    near = (
        name
        for name in sorted(condition.objects())
        if {frozenset((f"{name}.{axis}", f"{other}.{axis}")) for axis in "xy"} <= said
    )
    return next(near, None)


def at_rest(world: World, robot: Robot) -> World:
    """Return the world with all objects where they will have rolled out, if nothing stops them before."""
    objects = {name: robot.ball.at_rest(state) for name, state in world.objects.items()}
    return dataclasses.replace(world, objects=objects)


def has_left(world: World, call: TopCall, robot: Robot) -> bool:
    """Return whether the object followed is farther from the goal of `call` than its pre-condition allows."""
    state, goal, name = state_of(world, robot), goal_variables(call.goal), followed(call.top)
    terms = (term for term in call.top.pre.terms if name in Condition((term,)).objects())
    return any((term.error(state, goal) or 0.0) > term.tolerance for term in terms)


def at_object(goal: Goal, world: World, name: str) -> Goal:
    """Return a goal with the position of an object, where it is known."""
    there = world.objects.get(name)
    return goal if there is None else dataclasses.replace(goal, pose=goal.pose._replace(x=there.x, y=there.y))


def is_lost(world: World, robot: Robot, name: str) -> bool:
    """Return whether an object that was in front of the robot is known, and there no more."""
    return name in world.objects and robot.hold_offset(world, name) > _LOST


def is_at_front(world: World, robot: Robot, name: str) -> bool:
    """Return whether the robot's front touches an object, or nearly: what moves it then is the robot."""
    return robot.hold_offset(world, name) < robot.fin_length + _TOUCHING


def is_in_the_way(world: World, robot: Robot, name: str) -> bool:
    """Return whether the robot, braking as actions do, cannot stop before an object, or drive round it.

    Planning from there would take long and find nothing.
    """
    there, v = world.objects.get(name), world.robot.v
    if there is None or v <= 0.0:
        return False
    place = world.robot.pose.relative(Pose(there.x, there.y, 0.0))
    reach = robot.front + robot.fin_length + robot.ball.radius + _ROOM
    braking = v * v / (2.0 * robot.limits.brake)
    beside = abs(place.y) > robot.half_width + robot.ball.radius + _ROOM
    return not beside and 0.0 < place.x < reach + braking
