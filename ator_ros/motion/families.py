"""Families of ideal motions, made from a robot's limits: their times are features.

A family is some kinds of motion, each a turn, a straight drive, a turn and a straight run, of which the
fastest counts. Kinds are given as shares of the limits. `ator_ros.motion.choosing` chooses them for a robot.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ator_ros.motion.durations import rates_of, turn_time
from ator_ros.motion.motion_ends import KIND, Rows, Rules
from ator_ros.motion.turn_tables import TurnTables, Way, turn_tables
from ator_ros.robot.description import Limits

_DETOUR = 7.2
"""Cost, in m of driving at full speed, of each m that a drive passes an object at the goal too near."""


class Kind(NamedTuple):
    """One kind of motion: turn, drive straight, turn, run straight to the goal.

    Attributes
    ----------
    first, last : Way
        How the turns are driven; the last as seen from the goal, backward in time.
    share : float
        Speed between last turn and run: between the least (0) and greatest (1) from which the run can end as
        it shall, or, where the run is as long as that needs, a share of the limit; NaN where there is no run.
    entry : float
        Speed in m/s to reach in a straight lead before the first turn; NaN where that begins at once.
    backward : bool
        Whether the drive between the turns goes backward.
    least_start, least_arrival : float
        Least speeds in m/s at the start and at the goal of such motions.
    """

    first: Way
    last: Way
    share: float = 0.0
    entry: float = np.nan
    backward: bool = False
    least_start: float = -np.inf
    least_arrival: float = -np.inf


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
    def _ways(self) -> tuple[Way, ...]:
        return tuple(dict.fromkeys(way for kind in self.kinds for way in (kind.first, kind.last)))

    @cached_property
    def tables(self) -> TurnTables:
        """The tables of all ways to turn."""
        return turn_tables(self.limits, self._ways)

    @cached_property
    def rows(self) -> Rows:
        """The kinds as rows."""
        rows = [
            (
                self._ways.index(kind.first),
                self._ways.index(kind.last),
                kind.first.change,
                kind.last.change,
                kind.first.rate,
                kind.last.rate,
                kind.share,
                kind.entry,
                kind.least_start,
                kind.least_arrival,
                -1.0 if kind.backward else 1.0,
            )
            for kind in self.kinds
        ]
        return np.array(rows, dtype=KIND)

    @cached_property
    def missed(self) -> tuple[float, float]:
        """Time (s) and angle (rad) where the ends are so near each other that no motion has room."""
        turned = 2.0 * np.pi if self.forward else np.pi
        return float(2.0 * turn_time(turned, self.limits.w, self.limits.aw)), 2.0 * turned

    @cached_property
    def _rules(self) -> Rules:
        run = np.nan if self.run is None else self.run
        detour = _DETOUR / self.limits.v
        return Rules(rates_of(self.limits), run, self.passing, detour, self.forward, 0.0)

    def rules(self, hold: float) -> Rules:
        """Return what holds for all kinds, with an object `hold` m ahead of the destination."""
        return self._rules._replace(hold=hold)


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
        Kind(Way(row.first * limits.a, limits.w), Way(row.last * limits.a, limits.w), row.share,
             backward=row.backward)
        for row in rows
    )  # fmt: skip
