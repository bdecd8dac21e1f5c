"""The ball in TOPs: who needs it, who drives to it, who holds it, all read from their conditions."""

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

_AT_HOLD = frozenset({("hold.x", "ball.x"), ("hold.y", "ball.y")})
_AT_FRONT = frozenset({("ball.x", "hold.x"), ("ball.y", "hold.y")})
_AT_GOAL = frozenset({("ball.x", "goal.x"), ("ball.y", "goal.y")})
_TOUCHING = 0.08
_ROOM = 0.06
_LOST = 0.12


def needs_ball(top: Top) -> bool:
    """Return whether the conditions of a TOP speak of the ball."""
    terms = (*top.pre.terms, *top.post.terms)
    return any(str(name).startswith("ball.") for term in terms for name in (term.variable, term.target))


def ball_user(calls: Iterable[TopCall]) -> str | None:
    """Return the name of the first TOP that needs the ball; None when none does."""
    return next((call.top.name for call in calls if needs_ball(call.top)), None)


def starts_holding(top: Top) -> bool:
    """Return whether a TOP starts with the ball in front of the robot."""
    return _holds(top.pre)


def ends_holding(top: Top) -> bool:
    """Return whether a TOP ends with the ball in front of the robot."""
    return _holds(top.post)


def keeps_holding(top: Top) -> bool:
    """Return whether a TOP starts and ends with the ball in front of the robot."""
    return starts_holding(top) and ends_holding(top)


def drives_to_ball(top: Top) -> bool:
    """Return whether a TOP's goal is where the ball lies, so that it moves when the ball does."""
    return _says(top.pre, _AT_GOAL)


def fetches_ball(top: Top) -> bool:
    """Return whether a TOP drives to the ball and ends with it in front of the robot."""
    return drives_to_ball(top) and ends_holding(top)


def _holds(condition: Condition) -> bool:
    return _says(condition, _AT_HOLD) or _says(condition, _AT_FRONT)


def _says(condition: Condition, pairs: frozenset[tuple[str, str]]) -> bool:
    return pairs <= {(term.variable, str(term.target)) for term in condition.terms}


def at_rest(world: World, robot: Robot) -> World:
    """Return the world with the ball where it will have rolled out, if nothing stops it before."""
    if world.ball is None:
        return world
    return dataclasses.replace(world, ball=robot.ball.at_rest(world.ball))


def has_left(world: World, call: TopCall, robot: Robot) -> bool:
    """Return whether the ball is farther from the goal of `call` than its pre-condition allows."""
    state, goal = state_of(world, robot), goal_variables(call.goal)
    terms = (term for term in call.top.pre.terms if (term.variable, term.target) in _AT_GOAL)
    return any((term.error(state, goal) or 0.0) > term.tolerance for term in terms)


def at_ball(goal: Goal, world: World) -> Goal:
    """Return a goal with the position of the ball, where one is known."""
    ball = world.ball
    return goal if ball is None else dataclasses.replace(goal, pose=goal.pose._replace(x=ball.x, y=ball.y))


def is_lost(world: World, robot: Robot) -> bool:
    """Return whether a ball that was in front of the robot is there no more."""
    return world.ball is not None and robot.hold_offset(world) > _LOST


def is_at_front(world: World, robot: Robot) -> bool:
    """Return whether the robot's front touches the ball, or nearly: what moves it then is the robot."""
    return robot.hold_offset(world) < robot.fin_length + _TOUCHING


def is_in_the_way(world: World, robot: Robot) -> bool:
    """Return whether the robot, braking as actions do, cannot stop before the ball, much less drive round it.

    Planning from there would take long and find nothing.
    """
    ball, v = world.ball, world.robot.v
    if ball is None or v <= 0.0:
        return False
    place = world.robot.pose.relative(Pose(ball.x, ball.y, 0.0))
    reach = robot.front + robot.fin_length + robot.ball.radius + _ROOM
    braking = v * v / (2.0 * robot.limits.brake)
    beside = abs(place.y) > robot.half_width + robot.ball.radius + _ROOM
    return not beside and 0.0 < place.x < reach + braking
