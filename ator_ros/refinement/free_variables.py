"""Which variables of a chain's subgoals are free (paper, section 4.2): computed, not listed.

A goal variable is free when the plan opens it, it has a range, no condition binds it, every action whose
performance it may change has a performance model, and one of these models uses a direct variable that it
changes.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import GOAL_VARIABLES, direct_name, goal_values
from ator_ros.robot.description import Robot
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.tops.ranges import USUAL_RANGES, Range, Ranges


class PredictsPerformance(Protocol):
    """What refinement needs of a performance model (`ator_ros.performance.model` has the learned one)."""

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the prediction depends on."""

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ("duration",)) -> Any:
        """Return a prediction whose fields named in `measures` are arrays of shape (n,)."""


@dataclass(frozen=True, slots=True)
class FreeVariable:
    """One free variable: of which subgoal of the chain (counted from 0), its name, and its range.

    `limits` tells what bounds the range beyond that of such variables: regions, and the models' experience.
    """

    subgoal: int
    name: str
    domain: Range
    limits: tuple[str, ...] = ()


class Cause(enum.Enum):
    """The kind of cause why an open variable is not free, in words."""

    BOUND = "bound"
    NO_RANGE = "not among the `variables` of the domain"
    NO_EXPERIENCE = "no experience"
    NO_EFFECT = "no effect"
    REGION = "outside the region"


@dataclass(frozen=True, slots=True)
class NotFree:
    """A variable that the plan opens and that is not free: subgoal (from 0), name, and why."""

    subgoal: int
    name: str
    reason: str
    cause: Cause


@dataclass(frozen=True, slots=True)
class Analysis:
    """The free variables of a chain, and those that the plan opens and that are not free.

    `outside` are sentences on quantities of the chain that lie outside the models' experience.
    """

    free: tuple[FreeVariable, ...]
    not_free: tuple[NotFree, ...]
    outside: tuple[str, ...] = ()


def names_of(chain: TopChain, free: Sequence[FreeVariable]) -> list[tuple[str, ...]]:
    """Return the names of the free variables of each subgoal."""
    return [
        tuple(variable.name for variable in free if variable.subgoal == index)
        for index in range(len(chain.calls))
    ]


def start_variables(name: str, point: Point) -> frozenset[str]:
    """Return the direct variables of the next action's start that the goal variable `name` changes."""
    if name not in GOAL_VARIABLES:
        return frozenset()
    if name == "yaw" and point is Point.HOLD:
        return frozenset({"yaw", "x", "y"})
    return frozenset({"v" if name == "speed" else name})


def analyse(
    chain: TopChain,
    models: Mapping[str, PredictsPerformance],
    robot: Robot,
    ranges: Ranges = USUAL_RANGES,
) -> Analysis:
    """Compute the free variables of a chain.

    Parameters
    ----------
    chain : TopChain
        The chain, of any length.
    models : mapping
        Action name to performance model; an action may lack one.
    robot : Robot
        Sizes and limits that bound the ranges.
    ranges : mapping, optional
        Goal variable to its range; variables without one are never free.
    """
    free: list[FreeVariable] = []
    not_free: list[NotFree] = []
    bound = bindings(tuple(call.top for call in chain.calls))
    for index, call in enumerate(chain.calls):
        for name in _opened(call):
            reason = bound.get((index, name)) or _why_closed(call, name)
            found = (reason, Cause.BOUND) if reason else None
            if found is None and name not in ranges:
                found = "without a range", Cause.NO_RANGE
            found = found or _why_unknown(chain, index, name, models)
            if found is None:
                free.append(FreeVariable(index, name, ranges[name](robot, call.goal)))
            else:
                not_free.append(NotFree(index, name, *found))
    return Analysis(tuple(free), tuple(not_free))


def _opened(call: TopCall) -> list[str]:
    """Return what a call opens or means to open, in the order of its goal's variables."""
    names = list(goal_values(call.goal))
    opened = names if EVERYTHING in call.open else [name for name in names if name in call.open]
    return opened + sorted(call.open - {EVERYTHING, *names})


def _why_closed(call: TopCall, name: str) -> str | None:
    """Return why an opening does not count, whatever the conditions of other steps say."""
    if name not in goal_values(call.goal):
        return f"no goal variable, expected one of {', '.join(goal_values(call.goal))}"
    if call.opens(name):
        return None
    return f'named by the post-condition of {call.top.name}: "{EVERYTHING}" leaves it, its own name opens it'


def _why_unknown(
    chain: TopChain, index: int, name: str, models: Mapping[str, PredictsPerformance]
) -> tuple[str, Cause] | None:
    """Return why nothing is known of how the variable changes the performance."""
    changed = {index: frozenset({direct_name(name)})}
    following = start_variables(name, chain.calls[index].goal.point)
    if following and index + 1 < len(chain.calls):
        changed[index + 1] = following
    actions = {step: chain.calls[step].top.action for step in changed}
    lacking = [step for step, action in actions.items() if action not in models]
    if lacking:
        step = lacking[0]
        reason = f"of unknown effect: step {step + 1} ({actions[step]}), which it may change, has no model"
        return reason, Cause.NO_EXPERIENCE
    if any(changed[step] & models[actions[step]].used_variables for step in changed):
        return None
    return "used by no performance model of a neighbouring action", Cause.NO_EFFECT
