"""How a chain went, in one line for the result of its goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ator_ros.actions.goal_variables import STOP
from ator_ros.printable import listed, one_line, printable

_MOST_CHANGES = 4  # in the line; "and 2 more" stands for the others
_MOST_STEPS = 12  # of an order
_MOST_REASON = 150  # characters


def changes_of(answer: Any) -> list[str]:
    """Return what an answer of refinement changed: the order, and each free variable."""
    if not answer.refined:
        return []
    order = list(answer.order) or list(range(len(answer.chain.calls)))
    tops = {index: call.top for index, call in zip(order, answer.chain.calls, strict=False)}
    changes = [
        f"{_change(free)} at step {free.subgoal + 1} ({printable(tops[free.subgoal])})"
        for free in answer.free
        if free.subgoal in tops and free.after != free.before
    ]
    if order != sorted(order):
        changes.insert(0, f"order {listed([str(index + 1) for index in order], _MOST_STEPS)}")
    return changes


def _change(free: Any) -> str:
    if free.name == "yaw":
        turn = math.degrees(math.remainder(free.after - free.before, math.tau))
        return f"{turn:+.0f}°"
    if free.name == STOP:
        return "a stop" if free.after else "no stop"
    return f"{printable(free.name)} {free.after:.3g}"


def result_line(record: Any, *, wanted: bool, changes: Sequence[str]) -> str:
    """Return the reason of a chain's end, after success with its durations and what refinement did.

    Parameters
    ----------
    record : ChainPerformance
        The record of the chain.
    wanted : bool
        Whether the goal asked for refinement.
    changes : sequence of str
        See `changes_of`.
    """
    reason = record.outcome.reason
    driven = record.actual.duration
    predicted = record.predicted.duration
    if record.outcome.code != record.outcome.SUCCEEDED or not math.isfinite(driven):
        return one_line(reason)
    times = f"{driven:.2f} s driven"
    if math.isfinite(predicted):
        times = f"{times}, {predicted:.2f} s predicted"
        bound = record.predicted.bound
        if driven > bound > 0.0:
            times = f"{times}; nine of ten runs take less than {bound:.2f} s"
    line = f"{reason}: {times}"
    if not wanted:
        return one_line(line)
    if record.refined and changes:
        saved = record.gain.predicted
        gain = f", predicted to save {saved:.2f} s" if math.isfinite(saved) else ""
        return one_line(f"{line}; refined: {listed(changes, _MOST_CHANGES)}{gain}")
    return one_line(f"{line}; {printable(record.refinement, _MOST_REASON)}")
