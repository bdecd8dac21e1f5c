"""Which goal variables the conditions of a chain bind (paper, section 4.2).

It is read from the conditions alone. A condition binds a goal variable where it relates what the
variable determines to something else: a step that starts with an object's x near goal.x has its x
where the object lies. A condition that holds for every value of the variable, as robot.yaw near
goal.yaw does after a drive, states what the step achieves and binds nothing. Nor does a range about
a number, or a relation between places: they bound what may be chosen.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Region

Variable = tuple[int, str]
"""A goal variable of a chain: the step, from 0, and its name."""


class _Value(NamedTuple):
    """A symbolic value, and the goal variables that determine it; equal texts are equal values."""

    text: str
    depends: frozenset[Variable]


_State = dict[str, _Value]


@lru_cache(maxsize=128)
def bindings(tops: tuple[Top, ...]) -> Mapping[Variable, str]:
    """Return the goal variables that conditions bind in a chain of these TOPs, with the reasons.

    Every condition counts: the step's own, and that of each later step that depends on what it
    achieves.
    """
    found: dict[Variable, str] = {}
    state: _State = {}
    for step, top in enumerate(tops):
        where = f"step {step + 1} ({top.name})"
        before = _bound_by(
            top.pre,
            state,
            step,
            f"the pre-condition of {where}",
        )
        state = _after(top, state, step)
        later = _bound_by(
            top.post,
            state,
            step,
            f"the post-condition of {where}",
        )
        for variable, reason in (*before.items(), *later.items()):
            found.setdefault(variable, reason)
    return MappingProxyType(found)


def _bound_by(
    condition: Condition,
    state: _State,
    step: int,
    source: str,
) -> dict[Variable, str]:
    """Return the variables that `condition` binds in `state`, each with the first reason."""
    found: dict[Variable, str] = {}
    for term in condition.terms:
        if isinstance(term, Region) and term.bounds:
            continue
        value = _value(term.variable, state, step)
        target = _value(term.target, state, step)
        if value.text == target.text:
            continue
        for variable in value.depends | target.depends:
            found.setdefault(variable, f"bound by {source}: {term.variable} near {term.target}")
    return found


def _after(
    top: Top,
    state: _State,
    step: int,
) -> _State:
    """Return the state after a step in terms of goal variables; see `projected`."""
    arrival = top.arrival() if top.arrives else {}
    after = {**state, **{name: _of_goal(step, *by) for name, by in arrival.items()}}
    placed = {}
    for term in top.post.terms:
        if term.variable in arrival:
            continue
        target = _value(term.target, after, step)
        away = f"{target.text} with {term!r}" if term.offset else target.text
        placed[term.variable] = target._replace(text=away)
    return after | placed


def _of_goal(step: int, *names: str) -> _Value:
    """Return the value that goal variables of a step determine; 0 without any."""
    if not names:
        return _value(0.0, {}, step)
    return _Value(f"{step}: {' '.join(names)}", frozenset((step, name) for name in names))


def _value(
    name: str | float,
    state: _State,
    step: int,
) -> _Value:
    if not isinstance(name, str):
        return _Value(repr(float(name)), frozenset())
    if name.startswith("goal."):
        return _of_goal(step, name.removeprefix("goal."))
    return state.get(name, _Value(name, frozenset()))
