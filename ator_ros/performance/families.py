"""The kinds of ideal motions whose times are features: driving, approaching the ball, dribbling."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ator_ros.performance.turns import Indices, RealArray, TurnTables, Way, turn_tables
from ator_ros.robot import Limits, Robot

RUN = 0.25  # m straight up to a ball, twice the length of the fins that catch it
PASSING = 0.4  # m that a straight drive keeps from the ball: half a robot and half a ball, and some


class Kind(NamedTuple):
    """One kind of motion: turn, drive straight, turn, run straight to the goal.

    Attributes
    ----------
    direction : float
        1 for driving forward, -1 in reverse.
    first, last : Way
        How the turns are driven; the last as seen from the goal, backward in time.
    share : float
        Speed between last turn and run: between the least (0) and greatest (1) from which the run can end as
        it shall, or, where the run is as long as that needs, a share of the limit.
    entry : float
        Speed in m/s to gain in a straight lead before the first turn; with more, it begins at once.
    first_side, last_side : float
        Which way the turns go: 1 left, -1 right.
    """

    direction: float
    first: Way
    last: Way
    share: float
    entry: float
    first_side: float
    last_side: float


class Columns(NamedTuple):
    """The kinds of a family as arrays of shape (kinds, 1), to broadcast against situations."""

    first_way: Indices
    last_way: Indices
    direction: RealArray
    first_change: RealArray
    last_change: RealArray
    share: RealArray
    entry: RealArray
    first_side: RealArray
    last_side: RealArray


@dataclass(frozen=True)
class Family:
    """Kinds of motion, of which the fastest counts.

    Attributes
    ----------
    limits : Limits
        Of speeds and accelerations.
    kinds : tuple of Kind
        The kinds.
    radius : float
        Of the circles, in m, with which the search for each motion begins.
    run : float or None
        Length in m of the straight run at the end; None where it is as long as its change of speed needs.
    passing : float
        Distance in m that the straight drive keeps from a ball at the goal; 0 without a ball.
    """

    limits: Limits
    kinds: tuple[Kind, ...]
    radius: float
    run: float | None = 0.0
    passing: float = 0.0

    @cached_property
    def _ways(self) -> tuple[Way, ...]:
        return tuple(dict.fromkeys(way for kind in self.kinds for way in (kind.first, kind.last)))

    @cached_property
    def tables(self) -> TurnTables:
        """The tables of all ways to turn."""
        return turn_tables(self.limits, self._ways)

    @cached_property
    def columns(self) -> Columns:
        """The kinds as columns."""

        def column(values: Iterable[float]) -> RealArray:
            return np.array([[value] for value in values], dtype=np.float32)

        def ways(which: Iterable[Way]) -> Indices:
            return np.array([[self._ways.index(way)] for way in which], dtype=np.intp)

        kinds = self.kinds
        return Columns(
            ways(kind.first for kind in kinds),
            ways(kind.last for kind in kinds),
            column(kind.direction for kind in kinds),
            column(kind.first.change for kind in kinds),
            column(kind.last.change for kind in kinds),
            column(kind.share for kind in kinds),
            column(kind.entry for kind in kinds),
            column(kind.first_side for kind in kinds),
            column(kind.last_side for kind in kinds),
        )


def _to_all_sides(rows: Iterable[tuple[float, Way, Way, float, float]]) -> tuple[Kind, ...]:
    sides = list(itertools.product((1.0, -1.0), repeat=2))
    return tuple(Kind(*row, *side) for row in rows for side in sides)


@lru_cache(maxsize=8)
def drive_family(robot: Robot) -> Family:
    """Give the motions without a ball: forward or in reverse, at the limits throughout."""
    limits = robot.limits
    forward = (1.0, Way(limits.a, limits.w), Way(limits.brake, limits.w), 0.0, -limits.v)
    reverse = (-1.0, Way(-limits.a, limits.w), Way(-limits.brake, limits.w), 0.0, -limits.v)
    return Family(limits, _to_all_sides((forward, reverse)), radius=0.2)


@lru_cache(maxsize=8)
def approach_family(robot: Robot) -> Family:
    """Give the motions up to a ball: forward or in reverse to behind it, then straight."""
    limits = robot.limits
    gain, lose = Way(limits.a, limits.w), Way(limits.brake, limits.w)
    back, back_lose = Way(-limits.a, limits.w), Way(-limits.brake, limits.w)
    at_once = -limits.v
    rows = (
        (1.0, gain, lose, 1.0, at_once),
        (1.0, gain, lose, 0.5, at_once),
        (-1.0, back, back_lose, 0.2, at_once),
    )
    return Family(limits, _to_all_sides(rows), radius=0.2, run=RUN, passing=PASSING)


@lru_cache(maxsize=8)
def dribble_family(robot: Robot) -> Family:
    """Give the motions with the ball: forward only; the more speed a last turn loses, the wider it is."""
    limits = robot.dribble_limits
    wide, tight = (Way(limits.a, limits.w), 0.0), (Way(0.25 * limits.a, limits.w), 0.2 * limits.v)
    # Speed before the straight run, braking and rate of the turn before it, as shares of the limits.
    short, curve, fast = (0.3, 0.0, 0.83), (0.5, 0.0, 1.0), (0.95, 0.5, 0.83)
    slow, slower = (0.6, 0.9, 0.5), (0.3, 0.5, 0.65)
    rows = [
        (1.0, first, Way(brake * limits.brake, rate * limits.w), speed, entry)
        for (first, entry), ends in (
            (wide, (short, curve, fast, slow, slower)),
            (tight, (short, curve, slower)),
        )
        for speed, brake, rate in ends
    ]
    return Family(limits, _to_all_sides(rows), radius=0.3, run=None)
