"""What a replay writes: its clock, and a chain with predicted and actual times, step by step."""

from __future__ import annotations

import math

from ator_ros.viewing.markdown import plain, seconds
from ator_ros.viewing.player import Player
from ator_ros.viewing.recorded import RecordedStep
from ator_ros.viewing.recording import PlayedChain


def clock(player: Player, stamp: float) -> str:
    """Return the played time, and the robot's own."""
    state = "" if player.playing else " (paused)"
    return f"**{player.seconds:.2f} s** of {player.duration:.2f} s{state} · stamp {stamp:.2f} s"


def chain(played: PlayedChain | None, stamp: float, number: int, count: int) -> str:
    """Return a Markdown table of a chain as far as it has been executed at a stamp (s).

    Parameters
    ----------
    played : PlayedChain or None
        The chain.
    stamp : float
        What ended later is not shown yet.
    number, count : int
        Which chain it is, from 1, of how many.
    """
    if played is None:
        return f"No chain yet; {count} {'is' if count == 1 else 'are'} to come."
    driven, steps = played.chain.driven, played.chain.steps
    missed = driven.tops[max((step.number + 1 for step in steps), default=0) :]
    unknown = [math.nan] * len(missed)
    heads = [*(plain(name) for name in (*(step.top for step in steps), *missed)), "chain"]
    is_over = stamp >= driven.ended
    errors = [*(_error(step, stamp) for step in steps), *unknown, driven.error if is_over else math.nan]
    rows = (
        ("predicted", [*(step.predicted for step in steps), *unknown, driven.predicted]),
        ("driven", [*(_driven(step, stamp) for step in steps), *unknown, _whole(played, stamp)]),
        ("difference", errors),
    )
    lines = [f"Chain {number} of {count}, {'refined' if driven.refined else 'as sent'}:", ""]
    lines += [f"| s | {' | '.join(heads)} |", f"|---|{'---|' * len(heads)}"]
    lines += [f"| {label} | {' | '.join(map(seconds, values))} |" for label, values in rows]
    return "\n".join([*lines, "", plain(played.chain.reason) if is_over else "under way"])


def _driven(step: RecordedStep, stamp: float) -> float:
    """Return how long a step took, or has taken until now."""
    if stamp < step.began:
        return math.nan
    return step.actual if stamp >= step.ended else stamp - step.began


def _error(step: RecordedStep, stamp: float) -> float:
    return step.predicted - step.actual if stamp >= step.ended else math.nan


def _whole(played: PlayedChain, stamp: float) -> float:
    driven = played.chain.driven
    return driven.actual if stamp >= driven.ended else stamp - played.chain.began
