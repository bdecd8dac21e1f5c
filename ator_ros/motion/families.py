"""Families of ideal motions at a robot's limits; the duration of the fastest motion is a feature.

A family is some kinds of motion, each a turn, a straight drive, a turn and a straight run. Kinds are given as
shares of the limits. `needed_kinds` chooses them for a robot from a fine grid: the next one is that which
brings the times nearest to those of the whole grid, until the rest would hardly bring them nearer, or at
`MOST` kinds.

The times follow from the direct variables and the robot's description alone. But these motions have the shape
of those of our own actions, so they describe much of what a model would otherwise learn.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from ator_ros.compiled import parallel_for
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import rates_of, turn_time
from ator_ros.motion.motion_search import (
    KIND,
    Rows,
    Rules,
    TurnProfile,
    TurnTables,
    search_fastest,
    turn_tables,
)
from ator_ros.robot.description import Limits

_DETOUR = 7.2
"""Cost, in m of driving at full speed, of each m that a drive passes an object at the goal too near."""


class Kind(NamedTuple):
    """One kind of motion: turn, drive straight, turn, run straight to the goal.

    Attributes
    ----------
    first, last : TurnProfile
        How the turns are driven; the last as seen from the goal, backward in time.
    share : float
        Speed between last turn and run: between the least (0) and the greatest (1) from which the run can
        reach its end speed, or a share of the limit if the run is as long as needed; NaN without a run.
    entry : float
        Speed in m/s to reach in a straight lead before the first turn; NaN where that begins at once.
    least_start, least_arrival : float
        Least speeds in m/s at the start and at the goal of such motions.
    direction : float
        1 if the drive between the turns goes forward, -1 if backward.
    """

    first: TurnProfile
    last: TurnProfile
    share: float = 0.0
    entry: float = np.nan
    least_start: float = -np.inf
    least_arrival: float = -np.inf
    direction: float = 1.0


@dataclass(frozen=True)
class Family:
    """Kinds of motion, of which the fastest counts.

    Attributes
    ----------
    limits : Limits
        Of speeds and accelerations.
    kinds : tuple of Kind
        The kinds.
    run : float or None
        Length in m of the straight run at the end; None where it is as long as its change of speed needs.
    passing : float
        Distance in m that the straight drive keeps from an object at the goal; 0 where there is none.
    forward : bool
        Whether the robot never drives backward.
    """

    limits: Limits
    kinds: tuple[Kind, ...]
    run: float | None = 0.0
    passing: float = 0.0
    forward: bool = False

    @cached_property
    def _profiles(self) -> tuple[TurnProfile, ...]:
        return tuple(dict.fromkeys(profile for kind in self.kinds for profile in (kind.first, kind.last)))

    @cached_property
    def tables(self) -> TurnTables:
        """The tables of all ways to turn."""
        return turn_tables(self.limits, self._profiles)

    @cached_property
    def rows(self) -> Rows:
        """The kinds as rows."""
        number = self._profiles.index
        rows = [
            (number(kind.first), number(kind.last), *kind.first, *kind.last, *kind[2:]) for kind in self.kinds
        ]
        return np.array(rows, dtype=KIND)

    @cached_property
    def missed(self) -> tuple[float, float]:
        """Time (s) and angle (rad) where the ends are so near each other that no motion has room."""
        turned = 2.0 * np.pi if self.forward else np.pi
        return float(2.0 * turn_time(turned, self.limits.w, self.limits.aw)), 2.0 * turned

    def rules(self, hold: float) -> Rules:
        """Return what holds for all kinds, with an object `hold` m ahead of the destination."""
        run = np.nan if self.run is None else self.run
        detour = _DETOUR / self.limits.v
        return Rules(rates_of(self.limits), run, self.passing, detour, self.forward, hold)


class FreeTurns(NamedTuple):
    """A kind of motion of a robot that may turn at its limit at any speed.

    Attributes
    ----------
    first, last : float
        Change of speed in both turns as shares of the limit; the last as seen from the goal.
    backward : bool
        Whether the drive between them goes backward.
    share : float
        See `Kind`.
    """

    first: float
    last: float
    backward: bool = False
    share: float = 0.0


def free_kinds(limits: Limits, rows: Iterable[FreeTurns]) -> tuple[Kind, ...]:
    """Return kinds of motion for these limits."""
    return tuple(
        Kind(
            TurnProfile(row.first * limits.a, limits.w),
            TurnProfile(row.last * limits.a, limits.w),
            row.share,
            direction=-1.0 if row.backward else 1.0,
        )
        for row in rows
    )


_NEAR = 0.0005
"""Choosing ends when the rest of the grid would save less than this share of the mean time."""
MOST = 120
"""Greatest number of kinds; the time of a search grows with it."""
_MOTIONS, _SEED = 2000, 5
_LATE = 3.0  # multiple of the least time, if no chosen kind leads to the destination


def needed_kinds(grid: Family, *, hold: float) -> list[int]:
    """Return the indices of the kinds of a family that are needed, the most useful first.

    It takes a second for a thousand kinds.

    Parameters
    ----------
    grid : Family
        With all kinds to choose from.
    hold : float
        Distance in m from the destination to the object in front of it.
    """
    ends = drawn_ends(grid.limits, _MOTIONS, np.random.default_rng(_SEED))
    times = np.empty((len(grid.kinds), _MOTIONS))
    for kind in range(len(grid.kinds)):
        result = np.empty((2, _MOTIONS))
        row = grid.rows[kind : kind + 1]
        search_fastest(ends, row, grid.tables, grid.rules(hold), (np.inf, 0.0), result, 0, _MOTIONS)
        times[kind] = result[0]
    return _chosen(times) or [0]  # no kind of the grid reaches a destination


def _chosen(times: FloatArray) -> list[int]:
    """Choose kinds by the times of each, (kinds, n): the one that saves the most is next."""
    least = times.min(axis=0)
    reached = np.isfinite(least)
    ratios = times[:, reached] / least[reached]
    so_far, picked = np.full(ratios.shape[1], _LATE), list[int]()
    while len(picked) < MOST and so_far.sum() > (1.0 + _NEAR) * len(so_far):
        picked.append(int(np.argmin(np.minimum(so_far, ratios).sum(axis=1))))
        so_far = np.minimum(so_far, ratios[picked[-1]])
    return picked


def drawn_ends(limits: Limits, count: int, rng: np.random.Generator) -> FloatArray:
    """Return ends of motions, (5, 1, count), as `search_fastest` takes them.

    They are up to 5 m apart, half of them nearer than the others. Half begin, and half end, at rest.
    """
    x, y, turn = (rng.uniform(-most, most, count) for most in (4.0, 3.0, np.pi))
    nearer = np.where(rng.random(count) < 0.5, rng.random(count), 1.0)
    speeds = limits.v * rng.random((2, count)) * rng.integers(0, 2, (2, count))
    return np.stack((nearer * x, nearer * y, turn, *speeds))[:, None]


_CHUNK = 60
"""Least number of situations per chunk: 60 microseconds."""


@dataclass(frozen=True)
class Motions:
    """The fastest motion of a family in each situation: arrays of shape (n,).

    Attributes
    ----------
    time : ndarray
        In s.
    turn : ndarray
        Sum of the angles of both turns in rad.
    """

    time: FloatArray
    turn: FloatArray

    def after(self, time: FloatArray) -> Motions:
        """Return the motions with `time` (s) before them."""
        return Motions(self.time + time, self.turn)


def fastest_motions(ends: FloatArray, family: Family, *, hold: float) -> Motions:
    """Return the fastest motion of `family` in each of n situations to one of m destinations.

    Parameters
    ----------
    ends : ndarray, shape (5, m, n)
        Both ends, in the frame of the start: destination x, y of the axle in m and heading there in rad,
        forward speeds at the start and at the destination in m/s. Whichever destination is reached first
        counts.
    family : Family
        Which motions there are.
    hold : float
        Distance in m from the destination to the object in front of it.
    """
    time, turn = result = np.empty((2, ends.shape[2]))
    search = partial(
        search_fastest, ends, family.rows, family.tables, family.rules(hold), family.missed, result
    )
    parallel_for(search, ends.shape[2], _CHUNK)
    return Motions(time, turn)
