"""What a refined chain changes of the plan, and whether the plan allows it."""

from __future__ import annotations

import math

from ator_ros.actions.goal_variables import goal_values
from ator_ros.robot.description import Robot
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import InvalidChainError, TopCall, TopChain
from ator_ros.tops.ranges import Ranges

_SAME = 1e-6
"""Difference in a variable's unit that a way through messages may make."""


def allowed_changes(
    plan: TopChain, refined: TopChain, robot: Robot, ranges: Ranges
) -> list[dict[str, float]]:
    """Return, step by step, the goal variables that `refined` changes, with their new values.

    Raises
    ------
    InvalidChainError
        It has other steps or goal variables than `plan`, or changes what `plan` does not open or a condition
        binds, or a value lies outside the variable's range, or it has none.
    """
    if [call.top for call in plan.calls] != [call.top for call in refined.calls]:
        raise InvalidChainError("expected the steps of the question")
    bound = bindings(tuple(call.top for call in plan.calls))
    changes = []
    for step, (old, new) in enumerate(zip(plan.calls, refined.calls, strict=True)):
        if old.goal.values.keys() != new.goal.values.keys():
            where = f"step {step + 1} ({old.top.name})"
            raise InvalidChainError(f"{where}: expected the goal variables of the question")
        values = _changed(old, new)
        for name, value in values.items():
            where = f"{name} of step {step + 1} ({old.top.name})"
            if not old.opens(name):
                raise InvalidChainError(f"{where}: expected {_value(old, name):g} as planned, got {value:g}")
            if (step, name) in bound:
                raise InvalidChainError(f"{where}: expected no change, it is {bound[step, name]}")
            if name not in ranges:
                raise InvalidChainError(f"{where}: expected no change, it has no range")
            allowed = ranges[name](robot, old.goal)
            if not allowed.contains(value):
                expected = f"expected a number from {allowed.low:g} to {allowed.high:g}"
                raise InvalidChainError(f"{where}: {expected}, got {value:g}")
        changes.append(values)
    return changes


def _changed(old: TopCall, new: TopCall) -> dict[str, float]:
    values = goal_values(new.goal)
    return {name: value for name, value in values.items() if not _same(name, _value(old, name), value)}


def _same(name: str, old: float, new: float) -> bool:
    if not math.isfinite(new):
        return False
    difference = new - old
    return abs(math.remainder(difference, math.tau) if name == "yaw" else difference) <= _SAME


def _value(call: TopCall, name: str) -> float:
    return goal_values(call.goal)[name]
