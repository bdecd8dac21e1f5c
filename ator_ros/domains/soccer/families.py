"""Soccer's families of ideal motions, made from a robot's description: up to a ball, with it, and to a shot.

With a ball, the greatest turn rate follows from what keeps the ball pressed to the front (`holding.push`):
the slower the robot is and the harder it brakes, the slower it must turn.

The kinds of motion here were chosen for the Pioneer, few enough for a search in half a millisecond.
`ator_ros.domains.soccer.chosen_motions` chooses others.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ator_ros.domains.soccer.planned.holding import fastest_rate
from ator_ros.domains.soccer.thresholds import approach_run, passing_distance
from ator_ros.motion.families import Family, FreeTurns, Kind, free_kinds
from ator_ros.motion.turn_tables import Way
from ator_ros.robot.description import Limits, Robot

AT_ONCE = NO_RUN = np.nan


class PushedTurns(NamedTuple):
    """A kind of motion with the ball; speeds and their changes are shares of the limits.

    Attributes
    ----------
    entry : float
        Speed before the first turn; NaN: the robot's own, as the turn begins at once.
    gain, loss : float
        Of speed in the first turn, and in the last.
    after : float
        Speed after the last turn; NaN: the one at the goal, as the turn ends there.
    slower : int
        By how many steps the last turn is slower (negative: faster) than the ball allows there.
    least_start, least_arrival : float
        Least speeds at the start and at the goal, where these decide how fast the robot may turn.
    rate : float
        Turn rate in the first turn; NaN: the fastest that the ball allows at its begin.
    """

    entry: float
    gain: float
    loss: float
    after: float
    slower: int = 0
    least_start: float = 0.0
    least_arrival: float = 0.0
    rate: float = np.nan


DRIVES = (
    FreeTurns(1.0, 1.0),
    FreeTurns(-0.6, -0.3, backward=True),
    FreeTurns(-1.0, -1.0, backward=True),
    FreeTurns(0.6, 0.3),
    FreeTurns(-0.6, -0.6, backward=True),
    FreeTurns(0.3, 0.6),
    FreeTurns(0.6, 0.6),
    FreeTurns(-0.3, -1.0, backward=True),
)
APPROACHES = (
    FreeTurns(1.0, 0.5, share=0.8),
    FreeTurns(0.3, -0.25, share=0.8),
    FreeTurns(-1.0, -1.0, backward=True, share=0.35),
    FreeTurns(0.1, 0.25),
    FreeTurns(1.0, 1.0, share=1.0),
    FreeTurns(0.6, 0.0, share=1.0),
    FreeTurns(-0.6, -1.0, backward=True, share=0.8),
    FreeTurns(0.1, 0.0, share=0.35),
)
DRIBBLES: tuple[PushedTurns, ...] = (
    PushedTurns(AT_ONCE, 0.75, 0.0, 0.5),
    PushedTurns(0.55, 0.0, 0.0, 0.4),
    PushedTurns(0.1, 0.0, 0.0, 0.1),
    PushedTurns(AT_ONCE, 0.96, 0.5, 0.3),
    PushedTurns(0.2, 0.25, 0.0, 0.4),
    PushedTurns(AT_ONCE, 0.96, 0.5, 0.6),
    PushedTurns(AT_ONCE, 0.96, 0.0, 0.4),
    PushedTurns(0.2, 0.25, 0.0, 0.2),
    PushedTurns(AT_ONCE, 0.96, 0.0, 0.95),
    PushedTurns(0.1, 0.0, 0.0, 0.3),
    PushedTurns(AT_ONCE, 0.96, 0.9, 0.4),
    PushedTurns(AT_ONCE, 0.75, 0.0, 0.75),
)
# Of all robots. Two last turns are a step off what the ball allows, as the shipped models learned with them.
_SHOTS: tuple[PushedTurns, ...] = (
    PushedTurns(AT_ONCE, 0.75, 0.0, 0.5),
    PushedTurns(AT_ONCE, 0.96, 0.0, 0.75),
    PushedTurns(0.1, 0.0, 0.0, 0.3, slower=1),
    PushedTurns(0.2, 0.25, 0.0, 0.3, slower=-1),
    PushedTurns(0.55, 0.0, 0.0, 0.5),
)


def drive_family(limits: Limits, rows: Iterable[FreeTurns] = DRIVES) -> Family:
    """Return the motions to a pose, forward or in reverse, of a robot with these limits."""
    return Family(limits, free_kinds(limits, rows))


def approach_family(robot: Robot, rows: Iterable[FreeTurns] = APPROACHES) -> Family:
    """Return the motions up to a ball: forward or in reverse to behind it, then straight."""
    kinds = free_kinds(robot.limits, rows)
    return Family(robot.limits, kinds, run=approach_run(robot), passing=passing_distance(robot))


def dribble_family(robot: Robot, rows: Iterable[PushedTurns] = DRIBBLES) -> Family:
    """Return the motions with the ball: forward only, no turn faster than the ball allows."""
    kinds = tuple(_pushed_kind(robot, row) for row in rows)
    return Family(pushing_limits(robot), kinds, run=None, forward=True)


@lru_cache(maxsize=8)
def shot_family(robot: Robot) -> Family:
    """Return the motions with the ball that end in a run at full speed; where it leads there is a choice."""
    return dribble_family(robot, _SHOTS)


def pushing_limits(robot: Robot) -> Limits:
    """Return the limits with the ball; raises NoHolderError where the robot cannot hold it."""
    return robot.holder_for("pushing a ball").limits


def _pushed_kind(robot: Robot, row: PushedTurns) -> Kind:
    limits = pushing_limits(robot)
    first, last = row.gain * limits.a, row.loss * limits.brake
    begin = row.least_start if np.isnan(row.entry) else row.entry
    end = row.least_arrival if np.isnan(row.after) else row.after
    rate = fastest_rate(robot, begin * limits.v, first) if np.isnan(row.rate) else row.rate * limits.w
    return Kind(
        Way(first, rate),
        Way(last, fastest_rate(robot, end * limits.v, -last, row.slower)),
        row.after,
        row.entry * limits.v,
        least_start=row.least_start * limits.v if row.least_start else -np.inf,
        least_arrival=row.least_arrival * limits.v if row.least_arrival else -np.inf,
    )
