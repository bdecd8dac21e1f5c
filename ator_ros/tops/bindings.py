"""Which goal variables the conditions of a chain bind (paper, section 4.2), read from the conditions alone.

A condition binds a goal variable where it relates what the variable determines to something else: a
step that starts with an object's x near goal.x has its x where the object lies. A condition that
holds for every value of the variable, as robot.yaw near goal.yaw does after a drive, states what
the step achieves and binds nothing. Nor does a range about a number, or a relation between places:
they bound what may be chosen.
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
    """Return the goal variables that conditions bind in a chain of these TOPs, each with the reason.

    Every condition counts: the step's own, and that of each later step that depends on what it
    achieves.
    """
    found: dict[Variable, str] = {}
    state: _State = {}
    for step, top in enumerate(tops):
        _collect(found, top.pre, state, step, f"the pre-condition of step {step + 1} ({top.name})")
        state = _after(top, state, step)
        _collect(
            found, top.post, state, step, f"the post-condition of step {step + 1} ({top.name})"
        )
    return MappingProxyType(found)


def _collect(
    found: dict[Variable, str], condition: Condition, state: _State, step: int, source: str
) -> None:
    """Add the variables that `condition` binds in `state`; the first reason is kept."""
    for term in condition.terms:
        if isinstance(term, Region) and term.bounds:
            continue
        value, target = _value(term.variable, state, step), _value(term.target, state, step)
        if value.text != target.text:
            for variable in value.depends | target.depends:
                found.setdefault(variable, f"bound by {source}: {term.variable} near {term.target}")


def _after(top: Top, state: _State, step: int) -> _State:
    """Return the state after a step, as `ator_ros.tops.chain.projected` does, in terms of goal variables."""
    arrival = (
        {name: _of_goal(step, *by) for name, by in top.arrival().items()} if top.arrives else {}
    )
    after = {**state, **arrival}
    placed = {}
    for term in top.post.terms:
        if term.variable not in arrival:
            target = _value(term.target, after, step)
            away = f"{target.text} with {term!r}" if term.offset else target.text
            placed[term.variable] = target._replace(text=away)
    return after | placed


def _of_goal(step: int, *names: str) -> _Value:
    """Return the value that goal variables of a step determine; 0 without any."""
    if not names:
        return _value(0.0, {}, step)
    return _Value(f"{step}: {' '.join(names)}", frozenset((step, name) for name in names))


def _value(name: str | float, state: _State, step: int) -> _Value:
    if not isinstance(name, str):
        return _Value(repr(float(name)), frozenset())
    if name.startswith("goal."):
        return _of_goal(step, name.removeprefix("goal."))
    return state.get(name, _Value(name, frozenset()))
