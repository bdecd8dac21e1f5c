"""What remains of a goal's plans while one of them is executed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ator_ros.actions.goal_variables import goal_values
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.objects import at_object, followed, has_left
from ator_ros.world.state import World

_SAME = 1e-6
_PLACE = ("x", "y")


@dataclass(frozen=True, slots=True)
class Continuation:
    """The steps of a plan that are not done; `number` is that of the plan among those of the goal, from 0."""

    number: int
    chain: TopChain


def awaited(calls: Sequence[TopCall]) -> Iterator[tuple[int, str]]:
    """Yield the steps that follow an object which no step before moves, from 0, and the object."""
    moved: set[str] = set()
    for index, call in enumerate(calls):
        name = followed(call.top)
        if name is not None and name not in moved:
            yield index, name
        moved |= call.top.post.objects()


def with_followed(chain: TopChain, resting: World, robot: Robot, *, step: int = 0) -> TopChain:
    """Return `chain` with the goals from `step` on where the objects lie that have left them.

    Parameters
    ----------
    chain : TopChain
        The chain.
    resting : World
        The state, with its objects at rest.
    robot : Robot
        Its sizes.
    step : int
        The first step that is not done, from 0.
    """
    for index, name in awaited(chain.calls[step:]):
        call = chain.calls[step + index]
        if has_left(resting, call, robot):
            chain = chain.with_goal(step + index, at_object(call.goal, resting, name))
    return chain


def continuations(
    plans: Sequence[TopChain], number: int, chain: TopChain, step: int, resting: World, robot: Robot
) -> tuple[Continuation, ...]:
    """Return how the other plans go on from here: after the steps that they share with what is done, or anew.

    Parameters
    ----------
    plans : sequence of TopChain
        The plans of the goal.
    number : int
        Number of the plan that is executed, from 0.
    chain, step
        The chain as it is executed, and the first step of it that is not done, from 0.
    resting, robot
        As for `with_followed`. What is no valid plan from there is left out.
    """
    found = []
    done = chain.calls[:step]
    for other, plan in enumerate(plans):
        if other == number:
            continue
        for rest in _rests(plan, done):
            moved = with_followed(rest, resting, robot)
            if not moved.violations(resting, robot):
                found.append(Continuation(other, moved))
                break
    return tuple(found)


def _rests(plan: TopChain, done: Sequence[TopCall]) -> Iterator[TopChain]:
    shared = len(done) < len(plan) and all(map(_same, done, plan.calls))
    if done and shared:
        yield TopChain(plan.calls[len(done) :])
    yield plan


def _same(done: TopCall, planned: TopCall) -> bool:
    """Return whether a step that is done is one that was planned, in all that this commits to."""
    if done.top != planned.top or done.goal.values.keys() != planned.goal.values.keys():
        return False
    there = goal_values(done.goal)
    return all(
        abs(math.remainder(there[name] - value, math.tau) if name == "yaw" else there[name] - value) <= _SAME
        for name, value in goal_values(planned.goal).items()
        if not planned.opens(name) and not (name in _PLACE and followed(planned.top))
    )


def switched(chain: TopChain, step: int, rest: TopChain) -> TopChain:
    """Return what is done of `chain` before `step`, and `rest` after it."""
    return dataclasses.replace(chain, calls=(*chain.calls[:step], *rest.calls))
