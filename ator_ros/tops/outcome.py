"""The outcome of a TOP, by its post-condition alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.actions.situation import Situation
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import state_of
from ator_ros.tops.objects import objects_in
from ator_ros.world.state import World


class NoTopError(ValueError):
    """A situation that fits no TOP."""


def unmet(top: Top, world: World, goal: Goal, robot: Robot) -> list[str]:
    """Return why the post-condition does not hold in `world`; empty if it holds."""
    return top.post.violations(state_of(world, robot), goal_values(goal))


def failure(top: Top, violations: Iterable[str]) -> str:
    """Return the reason of a failure from the violations of a post-condition."""
    return f"post-condition of {top.name}: {'; '.join(violations)}"


def shortfall(top: Top, world: World, goal: Goal, robot: Robot) -> float:
    """Return how far `world` is from the post-condition, in the unit of the worst variable; 0: it holds."""
    return top.post.shortfall(state_of(world, robot), goal_values(goal))


def may_settle(top: Top, world: World) -> bool:
    """Return whether an object of the post-condition still moves."""
    objects = (world.objects.get(name) for name in top.post.objects())
    return any(there is not None and not there.is_resting for there in objects)


def top_of(situation: Situation, tops: Sequence[Top], robot: Robot) -> Top:
    """Return the TOP that fits a situation.

    It has the same action and the same point of the robot, and names no object that the situation lacks.
    Among several, it is the first with the fewest violations of its pre-condition.

    Raises
    ------
    NoTopError
        There is none.
    """
    world = World(0.0, situation.robot, situation.objects)
    state, goal = state_of(world, robot), goal_values(situation.goal)
    suited = [
        top
        for top in tops
        if top.action == situation.action
        and top.point is situation.goal.point
        and set(objects_in(top)) <= set(situation.objects)
    ]
    if not suited:
        raise NoTopError(
            f"situation of {situation.action}: expected a TOP with this action, a goal for the "
            f"{situation.goal.point.value} and no objects but {sorted(situation.objects)}, got none of "
            f"{[top.name for top in tops]}"
        )
    return min(suited, key=lambda top: len(top.pre.violations(state, goal)))
