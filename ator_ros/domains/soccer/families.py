"""Soccer's families of ideal motions, made from a robot's description: up to a ball, with it, and to a shot.

With a ball, the greatest turn rate follows from what keeps the ball pressed to the front (`holding.push`):
the slower the robot is and the harder it brakes, the slower it must turn.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ator_ros.domains.soccer.planned.holding import fastest_rate
from ator_ros.domains.soccer.thresholds import approach_run, passing_distance
from ator_ros.motion.families import (
    Family,
    FreeTurns,
    Kind,
    free_kinds,
    gained_in_turn,
    needs_more_kinds,
    turning_radius,
)
from ator_ros.motion.turn_tables import Way
from ator_ros.robot.description import Limits, Robot

# Kinds were chosen as `benchmarks/motion_families.py` chooses; all numbers are shares of the limits.
_APPROACHES = (
    FreeTurns(1.0, 0.5, share=0.8),
    FreeTurns(0.3, -0.25, share=0.8),
    FreeTurns(-1.0, -1.0, backward=True, share=0.35),
    FreeTurns(0.1, 0.25),
    FreeTurns(1.0, 1.0, share=1.0),
    FreeTurns(0.6, 0.0, share=1.0),
    FreeTurns(-0.6, -1.0, backward=True, share=0.8),
    FreeTurns(0.1, 0.0, share=0.35),
)
_MORE_APPROACHES = (
    FreeTurns(0.0, 0.25, share=1.0),
    FreeTurns(-0.25, 0.0),
    FreeTurns(1.0, 0.25, share=0.8),
    FreeTurns(0.25, 0.6, share=1.0),
    FreeTurns(-0.6, -0.25),
    FreeTurns(1.0, 0.0, share=0.35),
    FreeTurns(1.0, 0.6, share=1.0),
    FreeTurns(-0.25, 0.0, share=1.0),
    FreeTurns(1.0, 1.0, share=0.8),
    FreeTurns(0.6, 1.0, share=1.0),
)
_AT_ONCE = np.nan
_WEAK_WITH_BALL, _WIDE_WITH_BALL = 0.5, 1.1
"""Speed gained in a turn below which, and radius in m at full speed above which, there are more dribbles."""


class PushedTurns(NamedTuple):
    """A kind of motion with the ball; speeds and their changes are shares of the limits.

    Attributes
    ----------
    entry : float
        Speed before the first turn; NaN: the robot's own, as the turn begins at once.
    gain, loss : float
        Of speed in the first turn, and in the last.
    after : float
        Speed after the last turn.
    slower : int
        By how many steps the last turn is slower (negative: faster) than the ball allows there.
    """

    entry: float
    gain: float
    loss: float
    after: float
    slower: int = 0


_DRIBBLES: tuple[PushedTurns, ...] = (
    PushedTurns(_AT_ONCE, 0.75, 0.0, 0.5),
    PushedTurns(0.55, 0.0, 0.0, 0.4),
    PushedTurns(0.1, 0.0, 0.0, 0.1),
    PushedTurns(_AT_ONCE, 0.96, 0.5, 0.3),
    PushedTurns(0.2, 0.25, 0.0, 0.4),
    PushedTurns(_AT_ONCE, 0.96, 0.5, 0.6),
    PushedTurns(_AT_ONCE, 0.96, 0.0, 0.4),
    PushedTurns(0.2, 0.25, 0.0, 0.2),
    PushedTurns(_AT_ONCE, 0.96, 0.0, 0.95),
    PushedTurns(0.1, 0.0, 0.0, 0.3),
    PushedTurns(_AT_ONCE, 0.96, 0.9, 0.4),
    PushedTurns(_AT_ONCE, 0.75, 0.0, 0.75),
)
_DRIBBLES_OF_THE_WEAK: tuple[PushedTurns, ...] = (
    PushedTurns(0.55, 0.75, 0.9, 0.5),
    PushedTurns(0.1, 0.96, 0.5, 0.5),
    PushedTurns(0.55, 0.0, 0.0, 0.5),
    PushedTurns(0.55, 0.5, 0.9, 0.2),
    PushedTurns(0.55, 0.96, 0.5, 0.5),
    PushedTurns(0.2, 0.5, 0.5, 0.3),
    PushedTurns(0.55, 0.25, 0.5, 0.3),
    PushedTurns(0.1, 0.96, 0.9, 0.5),
    PushedTurns(0.55, 0.25, 0.9, 0.5),
    PushedTurns(0.1, 0.96, 0.0, 0.3),
    PushedTurns(0.1, 0.96, 0.5, 0.3),
    PushedTurns(0.2, 0.5, 0.5, 0.5),
    PushedTurns(0.55, 0.0, 0.0, 0.1),
    PushedTurns(0.2, 0.96, 0.5, 0.5),
    PushedTurns(0.2, 0.0, 0.0, 0.4),
    PushedTurns(0.55, 0.5, 0.5, 0.3),
)
_DRIBBLES_OF_THE_WIDE: tuple[PushedTurns, ...] = (
    PushedTurns(0.55, 0.0, 0.0, 0.5),
    PushedTurns(_AT_ONCE, 0.5, 0.5, 0.5),
    PushedTurns(0.55, 0.0, 0.0, 0.2),
    PushedTurns(_AT_ONCE, 0.5, 0.5, 0.3),
    PushedTurns(0.2, 0.0, 0.0, 0.5),
    PushedTurns(_AT_ONCE, 0.5, 0.9, 0.5),
    PushedTurns(_AT_ONCE, 0.5, 0.0, 0.5),
    PushedTurns(_AT_ONCE, 0.5, 0.0, 0.2),
    PushedTurns(0.55, 0.0, 0.5, 0.3),
    PushedTurns(0.2, 0.0, 0.0, 0.2),
)
# Two last turns are a step off what the ball allows: the shipped models were learned with them.
_SHOTS: tuple[PushedTurns, ...] = (
    PushedTurns(_AT_ONCE, 0.75, 0.0, 0.5),
    PushedTurns(_AT_ONCE, 0.96, 0.0, 0.75),
    PushedTurns(0.1, 0.0, 0.0, 0.3, slower=1),
    PushedTurns(0.2, 0.25, 0.0, 0.3, slower=-1),
    PushedTurns(0.55, 0.0, 0.0, 0.5),
)


@lru_cache(maxsize=8)
def approach_family(robot: Robot) -> Family:
    """Return the motions up to a ball: forward or in reverse to behind it, then straight."""
    more = needs_more_kinds(robot.limits)
    kinds = free_kinds(robot.limits, (*_APPROACHES, *_MORE_APPROACHES) if more else _APPROACHES)
    return Family(robot.limits, kinds, run=approach_run(robot), passing=passing_distance(robot))


@lru_cache(maxsize=8)
def dribble_family(robot: Robot) -> Family:
    """Return the motions with the ball: forward only, no turn faster than the ball allows."""
    limits = _limits(robot)
    if gained_in_turn(limits) < _WEAK_WITH_BALL:
        return _pushing(robot, (*_DRIBBLES, *_DRIBBLES_OF_THE_WEAK))
    if turning_radius(limits) > _WIDE_WITH_BALL:
        return _pushing(robot, (*_DRIBBLES, *_DRIBBLES_OF_THE_WIDE))
    return _pushing(robot, _DRIBBLES)


@lru_cache(maxsize=8)
def shot_family(robot: Robot) -> Family:
    """Return the motions with the ball that end in a run at full speed; where it leads there is a choice."""
    return _pushing(robot, _SHOTS)


def _limits(robot: Robot) -> Limits:
    return robot.holder_for("pushing a ball").limits


def _pushing(robot: Robot, rows: Iterable[PushedTurns]) -> Family:
    return Family(_limits(robot), pushed_kinds(robot, rows), run=None, forward=True)


def pushed_kinds(robot: Robot, rows: Iterable[PushedTurns]) -> tuple[Kind, ...]:
    """Return kinds of motion with the ball; no turn is faster than it allows."""
    limits, kinds = _limits(robot), []
    for entry, gain, loss, after, slower in rows:
        first, last = gain * limits.a, loss * limits.brake
        begin = 0.0 if np.isnan(entry) else entry * limits.v
        ways = (
            Way(first, fastest_rate(robot, begin, first)),
            Way(last, fastest_rate(robot, after * limits.v, -last, slower)),
        )
        kinds.append(Kind(*ways, after, entry * limits.v))
    return tuple(kinds)
