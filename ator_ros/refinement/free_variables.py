"""Which variables of a chain's subgoals are free (paper, section 4.2): computed, not listed.

A goal variable is free when the plan does not commit to it, no condition of its TOP or of the next one binds
it, and the performance model of a neighbouring action uses a direct variable that it changes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Protocol

from ator_ros.actions.base import Goal, Point
from ator_ros.experience.situations import ARRIVAL_SPEED
from ator_ros.robot import Robot
from ator_ros.tops.chain import TopChain


class PerformanceModel(Protocol):
    """What refinement needs of a performance model (`ator_ros.performance.model` has the learned one)."""

    @property
    def used_variables(self) -> frozenset[str]:
        """Direct variables that the prediction depends on."""

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ("duration",)) -> Any:
        """Give a prediction whose fields named in `measures` are arrays of shape (n,)."""


@dataclass(frozen=True, slots=True)
class Domain:
    """The values that a goal variable may take.

    Attributes
    ----------
    low, high : float
        Bounds in the variable's unit (m, rad, m/s).
    steps : int
        How finely the first grid divides it, relative to other variables.
    periodic : bool
        The bounds are the same value, as with an angle.
    rest : float or None
        The value that an unrefined chain takes; None: the one at which the action alone is cheapest.
    """

    low: float
    high: float
    steps: int
    periodic: bool = False
    rest: float | None = None


def _speed_domain(robot: Robot, goal: Goal) -> Domain:
    limits = robot.dribble_limits if goal.point is Point.HOLD else robot.limits
    # No model knows faster arrivals than experience has.
    return Domain(0.0, min(limits.v, ARRIVAL_SPEED), 6, rest=0.0)


#: Domain of each goal variable; a new goal variable is a new row, here or in what is given to the refiner.
DOMAINS: Mapping[str, Callable[[Robot, Goal], Domain]] = MappingProxyType(
    {
        "x": lambda robot, _: Domain(-robot.field.length / 2, robot.field.length / 2, 16),
        "y": lambda robot, _: Domain(-robot.field.width / 2, robot.field.width / 2, 10),
        "yaw": lambda *_: Domain(-math.pi, math.pi, 36, periodic=True),
        "speed": _speed_domain,
    }
)


@dataclass(frozen=True, slots=True)
class FreeVariable:
    """One free variable: of which subgoal of the chain (counted from 0), its name, and its domain."""

    subgoal: int
    name: str
    domain: Domain


@dataclass(frozen=True, slots=True)
class Analysis:
    """The free variables of a chain, and why each other one is not free, as sentences."""

    free: tuple[FreeVariable, ...]
    reasons: tuple[str, ...]


def goal_values(goal: Goal) -> dict[str, float]:
    """Give the goal variables of `goal`: x, y, yaw of its pose (m, rad), and its other numbers by name."""
    values = dict(zip(goal.pose._fields, goal.pose, strict=True))
    kind: Any = type(goal)  # mypy takes a class whose instances hash for one that does not itself
    for name in _numbers(kind):
        values[name] = float(getattr(goal, name))
    return values


@cache
def _numbers(kind: type[Goal]) -> tuple[str, ...]:
    return tuple(item.name for item in dataclasses.fields(kind) if item.type == "float")


def with_values(goal: Goal, values: Mapping[str, float]) -> Goal:
    """Give `goal` with the goal variables in `values` replaced."""
    pose = goal.pose._replace(**{name: float(v) for name, v in values.items() if name in goal.pose._fields})
    others: dict[str, Any] = {name: float(v) for name, v in values.items() if name not in goal.pose._fields}
    return dataclasses.replace(goal, pose=pose, **others)


def goal_variable(name: str) -> str:
    """Give the direct variable that holds the goal variable `name`: yaw gives yawg."""
    return f"{name}g"


def start_variables(name: str, point: Point) -> frozenset[str]:
    """Give the direct variables of the next action's start that the goal variable `name` changes."""
    if name == "yaw" and point is Point.HOLD:
        return frozenset({"yaw", "x", "y"})
    return frozenset({"v" if name == "speed" else name})


def analyse(
    chain: TopChain,
    models: Mapping[str, PerformanceModel],
    robot: Robot,
    domains: Mapping[str, Callable[[Robot, Goal], Domain]] = DOMAINS,
) -> Analysis:
    """Compute the free variables of a chain.

    Parameters
    ----------
    chain : TopChain
        The chain, of any length.
    models : mapping
        Action name to performance model, one for each action of the chain.
    robot : Robot
        Sizes and limits that bound the domains.
    domains : mapping, optional
        Goal variable to its domain; variables without one are never free.
    """
    free: list[FreeVariable] = []
    reasons: list[str] = []
    for index, call in enumerate(chain.calls):
        for name in goal_values(call.goal):
            reason = _why_not_free(chain, index, name, models)
            if reason is None and name not in domains:
                reason = "has no domain"
            if reason is None:
                free.append(FreeVariable(index, name, domains[name](robot, call.goal)))
            else:
                reasons.append(f"{name} of subgoal {index + 1} ({call.top.name}) {reason}")
    return Analysis(tuple(free), tuple(reasons))


def _why_not_free(
    chain: TopChain, index: int, name: str, models: Mapping[str, PerformanceModel]
) -> str | None:
    call = chain.calls[index]
    following = chain.calls[index + 1] if index + 1 < len(chain.calls) else None
    if name in call.bound:
        return "is bound by the plan"
    if name in call.top.post.bound():
        return f"is bound by the post-condition of {call.top.name}"
    if following is not None and name in following.top.pre.bound():
        return f"is bound by the pre-condition of {following.top.name}"
    used = goal_variable(name) in models[call.top.action].used_variables
    if following is not None:
        changed = start_variables(name, call.goal.point)
        used = used or bool(changed & models[following.top.action].used_variables)
    return None if used else "is used by no model of a neighbouring action"
