"""Soccer's families of ideal motions, made from a robot's description: up to a ball, with it, and to a shot.

With a ball, the greatest turn rate follows from what keeps the ball pressed to the front (`holding.push`):
the slower the robot is and the harder it brakes, the slower it must turn.

Each robot has kinds of motion that are chosen for it (`ator_ros.motion.choosing`). The Pioneer's are few and
were chosen before, as its search must not take longer than half a millisecond, and the shipped models were
learned with them.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ator_ros.domains.soccer.planned.holding import MARGIN, fastest_rate, push
from ator_ros.domains.soccer.thresholds import approach_run, passing_distance
from ator_ros.motion.choosing import with_chosen_kinds
from ator_ros.motion.families import Family, FreeTurns, Kind, free_kinds
from ator_ros.motion.turn_tables import Way
from ator_ros.robot.description import Limits, Robot

_AT_ONCE = _NO_RUN = np.nan


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
    """

    entry: float
    gain: float
    loss: float
    after: float
    slower: int = 0
    least_start: float = 0.0
    least_arrival: float = 0.0


# What to choose from; all numbers are shares of the limits.
_CHANGES = (-1.0, -0.6, -0.25, 0.0, 0.25, 0.6, 1.0)
RUNS = (0.0, 0.35, 0.8, 1.0)
_LEADS = (0.1, 0.2, 0.35, 0.55, 0.8)
_LEAST = (0.0, 0.25, 0.5, 0.75)
_GAINS, _LOSSES = (0.0, 0.25, 0.5, 0.75, 0.96), (0.0, 0.5, 0.9)
_AFTER = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.75, 0.95)
_BEGINS = [(_AT_ONCE, least) for least in _LEAST] + [(lead, 0.0) for lead in _LEADS]
_ENDS = [(_NO_RUN, least) for least in _LEAST[1:]] + [(after, 0.0) for after in _AFTER]

_PIONEERS = Limits(v=1.2, w=2.4, a=0.8, brake=0.8, aw=4.0)
_PIONEERS_HELD = Limits(v=1.0, w=1.2, a=0.8, brake=0.5, aw=3.0)
_DRIVES = (
    FreeTurns(1.0, 1.0),
    FreeTurns(-0.6, -0.3, backward=True),
    FreeTurns(-1.0, -1.0, backward=True),
    FreeTurns(0.6, 0.3),
    FreeTurns(-0.6, -0.6, backward=True),
    FreeTurns(0.3, 0.6),
    FreeTurns(0.6, 0.6),
    FreeTurns(-0.3, -1.0, backward=True),
)
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
# Of all robots. Two last turns are a step off what the ball allows, as the shipped models learned with them.
_SHOTS: tuple[PushedTurns, ...] = (
    PushedTurns(_AT_ONCE, 0.75, 0.0, 0.5),
    PushedTurns(_AT_ONCE, 0.96, 0.0, 0.75),
    PushedTurns(0.1, 0.0, 0.0, 0.3, slower=1),
    PushedTurns(0.2, 0.25, 0.0, 0.3, slower=-1),
    PushedTurns(0.55, 0.0, 0.0, 0.5),
)


@lru_cache(maxsize=8)
def drive_family(limits: Limits) -> Family:
    """Return the motions to a pose, forward or in reverse, of a robot with these limits."""
    if limits == _PIONEERS:
        return Family(limits, free_kinds(limits, _DRIVES))
    return with_chosen_kinds(Family(limits, free_kinds(limits, free_grid((0.0,)))), hold=0.0)


@lru_cache(maxsize=8)
def approach_family(robot: Robot) -> Family:
    """Return the motions up to a ball: forward or in reverse to behind it, then straight."""
    limits = robot.limits
    rows = _APPROACHES if limits == _PIONEERS else free_grid(RUNS)
    family = Family(
        limits, free_kinds(limits, rows), run=approach_run(robot), passing=passing_distance(robot)
    )
    return family if limits == _PIONEERS else with_chosen_kinds(family, hold=robot.hold)


@lru_cache(maxsize=8)
def dribble_family(robot: Robot) -> Family:
    """Return the motions with the ball: forward only, no turn faster than the ball allows."""
    if _limits(robot) == _PIONEERS_HELD:
        return _pushing(robot, _DRIBBLES)
    grid = _pushing(robot, pushed_grid())
    holding = tuple(kind for kind in grid.kinds if _holds_ball(robot, kind))
    return with_chosen_kinds(dataclasses.replace(grid, kinds=holding or grid.kinds), hold=robot.hold)


@lru_cache(maxsize=8)
def shot_family(robot: Robot) -> Family:
    """Return the motions with the ball that end in a run at full speed; where it leads there is a choice."""
    return _pushing(robot, _SHOTS)


def free_grid(runs: Iterable[float]) -> list[FreeTurns]:
    """Return all kinds of motion of a robot that holds nothing, with speeds before the run from `runs`."""
    return [FreeTurns(*row) for row in itertools.product(_CHANGES, _CHANGES, (False, True), runs)]


def pushed_grid() -> list[PushedTurns]:
    """Return all kinds of motion with the ball."""
    ways = itertools.product(_BEGINS, _GAINS, _LOSSES, _ENDS)
    return [
        PushedTurns(entry, gain, loss, after, least_start=start, least_arrival=arrival)
        for (entry, start), gain, loss, (after, arrival) in ways
    ]


def _limits(robot: Robot) -> Limits:
    return robot.holder_for("pushing a ball").limits


def _pushing(robot: Robot, rows: Iterable[PushedTurns]) -> Family:
    return Family(_limits(robot), pushed_kinds(robot, rows), run=None, forward=True)


def pushed_kinds(robot: Robot, rows: Iterable[PushedTurns]) -> tuple[Kind, ...]:
    """Return kinds of motion with the ball; no turn is faster than it allows."""
    return tuple(_pushed_kind(robot, row) for row in rows)


def _pushed_kind(robot: Robot, row: PushedTurns) -> Kind:
    limits = _limits(robot)
    first, last = row.gain * limits.a, row.loss * limits.brake
    begin = row.least_start if np.isnan(row.entry) else row.entry
    end = row.least_arrival if np.isnan(row.after) else row.after
    return Kind(
        Way(first, fastest_rate(robot, begin * limits.v, first)),
        Way(last, fastest_rate(robot, end * limits.v, -last, row.slower)),
        row.after,
        row.entry * limits.v,
        least_start=row.least_start * limits.v if row.least_start else -np.inf,
        least_arrival=row.least_arrival * limits.v if row.least_arrival else -np.inf,
    )


def _holds_ball(robot: Robot, kind: Kind) -> bool:
    """Return whether the ball stays in front in both turns; a robot so weak may have no such turn."""
    begin = max(kind.least_start, 0.0) if np.isnan(kind.entry) else kind.entry
    end = max(kind.least_arrival, 0.0) if np.isnan(kind.share) else kind.share * _limits(robot).v
    pushed = push(robot, begin, kind.first.rate, kind.first.change)
    return min(pushed, push(robot, end, kind.last.rate, -kind.last.change)) >= MARGIN
