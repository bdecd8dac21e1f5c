"""The kinds of ideal motions whose times are features: driving, approaching the ball, dribbling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ator_ros.motion.durations import rates_of
from ator_ros.motion.motion_search import KIND, Rows, Rules
from ator_ros.motion.turns import TurnTables, Way, turn_tables
from ator_ros.robot.description import Limits, Robot

RUN = 0.25  # m straight up to a ball, twice the length of the fins that catch it
PASSING = 0.4  # m that a straight drive keeps from the ball: half a robot and half a ball, and some


class Kind(NamedTuple):
    """One kind of motion: turn, drive straight, turn, run straight to the goal.

    Attributes
    ----------
    first, last : Way
        How the turns are driven; the last as seen from the goal, backward in time.
    share : float
        Speed between last turn and run: between the least (0) and greatest (1) from which the run can end as
        it shall, or, where the run is as long as that needs, a share of the limit.
    entry : float
        Speed in m/s to reach in a straight lead before the first turn; NaN where that begins at once.
    backward : bool
        Whether the drive between the turns goes backward.
    """

    first: Way
    last: Way
    share: float = 0.0
    entry: float = np.nan
    backward: bool = False


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
        Distance in m that the straight drive keeps from a ball at the goal; 0 without a ball.
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
                -1.0 if kind.backward else 1.0,
            )
            for kind in self.kinds
        ]
        return np.array(rows, dtype=KIND)

    def rules(self, hold: float) -> Rules:
        """Return what holds for all kinds, with a ball `hold` m ahead of the destination."""
        run = np.nan if self.run is None else self.run
        return Rules(rates_of(self.limits), run, self.passing, self.forward, hold)


# The kinds below were chosen one by one, each as the one that brings the times nearest to those of all
# combinations of a fine grid. Changes of speed and rates of turn are shares of the limits.
_DRIVES = (
    # first turn, last turn, backward
    (1.0, 1.0, False),
    (-0.6, -0.3, True),
    (-1.0, -1.0, True),
    (0.6, 0.3, False),
    (-0.6, -0.6, True),
    (0.3, 0.6, False),
    (0.6, 0.6, False),
    (-0.3, -1.0, True),
)
_APPROACHES = (
    # first turn, last turn, speed between it and the run, backward
    (1.0, 0.5, 0.8, False),
    (0.3, -0.25, 0.8, False),
    (-1.0, -1.0, 0.35, True),
    (0.1, 0.25, 0.0, False),
    (1.0, 1.0, 1.0, False),
    (0.6, 0.0, 1.0, False),
    (-0.6, -1.0, 0.8, True),
    (0.1, 0.0, 0.35, False),
)
_AT_ONCE = np.nan
_DRIBBLES = (
    # speed before the first turn (m/s), its change and rate; change and rate of the last turn, speed after it
    (_AT_ONCE, 0.75, 1.0, 0.0, 1.0, 0.5),
    (0.55, 0.0, 1.0, 0.0, 1.0, 0.4),
    (0.1, 0.0, 0.67, 0.0, 0.67, 0.1),
    (_AT_ONCE, 0.96, 1.0, 0.5, 0.67, 0.3),
    (0.2, 0.25, 1.0, 0.0, 1.0, 0.4),
    (_AT_ONCE, 0.96, 1.0, 0.5, 0.83, 0.6),
    (_AT_ONCE, 0.96, 1.0, 0.0, 1.0, 0.4),
    (0.2, 0.25, 1.0, 0.0, 0.83, 0.2),
    (_AT_ONCE, 0.96, 1.0, 0.0, 1.0, 0.95),
    (0.1, 0.0, 0.67, 0.0, 0.83, 0.3),
    (_AT_ONCE, 0.96, 1.0, 0.9, 0.5, 0.4),
    (_AT_ONCE, 0.75, 1.0, 0.0, 1.0, 0.75),
)
_SHOTS = (
    (_AT_ONCE, 0.75, 1.0, 0.0, 1.0, 0.5),
    (_AT_ONCE, 0.96, 1.0, 0.0, 1.0, 0.75),
    (0.1, 0.0, 0.67, 0.0, 0.67, 0.3),
    (0.2, 0.25, 1.0, 0.0, 1.0, 0.3),
    (0.55, 0.0, 1.0, 0.0, 1.0, 0.5),
)


@lru_cache(maxsize=8)
def drive_family(robot: Robot) -> Family:
    """Return the motions without a ball, forward or in reverse."""
    limits = robot.limits
    kinds = (
        Kind(Way(first * limits.a, limits.w), Way(last * limits.a, limits.w), backward=backward)
        for first, last, backward in _DRIVES
    )
    return Family(limits, tuple(kinds))


@lru_cache(maxsize=8)
def approach_family(robot: Robot) -> Family:
    """Return the motions up to a ball: forward or in reverse to behind it, then straight."""
    limits = robot.limits
    kinds = (
        Kind(Way(first * limits.a, limits.w), Way(last * limits.a, limits.w), share, backward=backward)
        for first, last, share, backward in _APPROACHES
    )
    return Family(limits, tuple(kinds), run=RUN, passing=PASSING)


@lru_cache(maxsize=8)
def dribble_family(robot: Robot) -> Family:
    """Return the motions with the ball: forward only; the more speed a last turn loses, the wider it is."""
    return _pushing(robot.holder_for("pushing an object").limits, _DRIBBLES)


@lru_cache(maxsize=8)
def shot_family(robot: Robot) -> Family:
    """Return the motions with the ball that end in a run at full speed; where it leads there is a choice."""
    return _pushing(robot.holder_for("pushing an object").limits, _SHOTS)


def _pushing(limits: Limits, rows: Sequence[tuple[float, ...]]) -> Family:
    kinds = (
        Kind(Way(gain * limits.a, begin * limits.w), Way(lose * limits.brake, end * limits.w), share, entry)
        for entry, gain, begin, lose, end, share in rows
    )
    return Family(limits, tuple(kinds), run=None, forward=True)
