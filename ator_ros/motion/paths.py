"""The search for all turn-drive-turn paths between two poses, over all combinations of entries and exits.

For each pair of sides the heading of the straight drive is the only unknown: the drive must meet the last
turn. Its roots are bracketed on a grid of first turns, where the parts of both sides just add, and refined in
the tables of turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled, inlined
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.durations import Rates, change_distance, drive_time, rates_of, turn_time
from ator_ros.motion.manoeuvre import Side
from ator_ros.motion.turns import (
    EDGE,
    ENTRIES,
    FINE,
    STEP,
    WIDEST,
    TurnTable,
    look_up,
    place_of,
    turn_table,
)
from ator_ros.robot.description import Limits

_STRIDE = 9  # entries of the tables between two first turns of the grid: 5.625 degrees
_GRID_STEP = STEP * _STRIDE / FINE
_WORD = 32  # signs are collected in words of as many bits
_WORDS = 3
_GRID: FloatArray = _GRID_STEP * (np.arange(_WORDS * _WORD + 1, dtype=float) - _WORDS * _WORD // 2)
"""First turns of up to 270 degrees either way."""
_POINTS = len(_GRID)
_COS, _SIN = np.cos(_GRID), np.sin(_GRID)
_BITS = (1 << np.arange(_WORD)).astype(np.uint32)
_ALL = (1 << _WORD) - 1
_FULL_TURN = 2.0 * math.pi
_APPROXIMATE = 0.05  # m by which a drive is off before its root is refined


class Ends(NamedTuple):
    """Ways to drive one end of a path.

    Attributes
    ----------
    sides : ndarray, shape (5, n)
        A row for each field of `Side`.
    times : ndarray, shape (n,)
        Times of the straight parts in s.
    turns : TurnTable
        Where their turns end.
    """

    sides: FloatArray
    times: FloatArray
    turns: TurnTable

    def side(self, index: int) -> Side:
        """Return one of them."""
        return Side(*self.sides[:, index].tolist())


def entries_of(sides: Sequence[Side], limits: Limits) -> Ends:
    """Return the beginnings of paths: straight to the speed of the turn, then the turn."""
    length, outer, *turns = columns = _columns(sides)
    times = drive_time(length, outer, turns[0], limits)
    return Ends(columns, times, turn_table(columns[2:].T, limits))


def exits_of(sides: Sequence[Side], limits: Limits) -> Ends:
    """Return the ends of paths, as seen from the goal: the straight there begins at the speed of the turn."""
    length, outer, *turns = columns = _columns(sides)
    times = drive_time(length, turns[0], outer, limits)
    return Ends(columns, times, turn_table(columns[2:].T, limits))


def _columns(sides: Sequence[Side]) -> FloatArray:
    """Return the sides as columns, those with the same turn rate together."""
    rows = sorted(sides, key=lambda side: side.rate)
    return np.array(rows, dtype=float).reshape(-1, len(Side._fields)).T.copy()


class Paths(NamedTuple):
    """Paths between two poses, fastest first.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Their durations in s.
    entries, exits : ndarray of int, shape (n,)
        Their sides.
    firsts, lasts, drives : ndarray, shape (n,)
        Both turns in rad, the straight drive in m (negative: backward).
    """

    times: FloatArray
    entries: NDArray[np.intp]
    exits: NDArray[np.intp]
    firsts: FloatArray
    lasts: FloatArray
    drives: FloatArray


def find_paths(
    start: Pose,
    goal: Pose,
    entries: Ends,
    exits: Ends,
    limits: Limits,
    *,
    least_slack: float = -math.inf,
    longest: float = math.inf,
    most: int = 10_000,
) -> Paths:
    """Find the `most` fastest paths from `start` to `goal` with these sides, of up to `longest` s.

    Those are left out whose drive is less than `least_slack` (m) longer than its change of speed needs.
    """
    x, y, turn = map(float, start.relative(goal))
    found = _search(x, y, turn, entries, exits, rates_of(limits), float(least_slack), float(longest))
    columns = ranked(found, most).T.copy()
    return Paths(columns[0], columns[1].astype(np.intp), columns[2].astype(np.intp), *columns[3:])


def ranked(found: FloatArray, most: int) -> FloatArray:
    """Return the `most` rows, or fewer, whose first column, the time, is least, in ascending order."""
    if len(found) > most:
        found = found[np.argpartition(found[:, 0], most - 1)[:most]]
    return found[np.argsort(found[:, 0], kind="stable")]


class Turning(NamedTuple):
    """A turn next to the drive of a path, as seen from its end of the path.

    Its row in the table, the speed at its beginning (m/s), the change of speed (m/s^2), the greatest rate
    (rad/s).
    """

    row: int
    speed: float
    change: float
    rate: float


@compiled
def _search(
    x: float,
    y: float,
    turn: float,
    entries: Ends,
    exits: Ends,
    rates: Rates,
    least_slack: float,
    longest: float,
) -> FloatArray:
    """Return time, entry, exit, first turn, last turn and drive of each path, shape (n, 6)."""
    found, count, steps = np.empty((1024, 6)), 0, np.empty(_POINTS, dtype=np.intp)
    befores = np.empty((2, len(entries.times), _POINTS), dtype=np.float32)
    afters = np.empty((2, len(exits.times), _POINTS), dtype=np.float32)
    # Local names avoid reference counting at each access.
    sides1, sides2, times1, times2 = entries.sides, exits.sides, entries.times, exits.times
    (along1, across1), (along2, across2) = entries.turns, exits.turns
    cos, sin = math.cos(turn), math.sin(turn)
    _fill_befores(befores, x, y, entries, rates.aw)
    for around in range(-1, 2):
        # The whole change of heading may be either way round, or a full turn more.
        total = turn + around * _FULL_TURN
        _fill_afters(afters, total, exits, rates.aw)
        for entry in range(len(times1)):
            gaps1, drives1 = befores[0, entry], befores[1, entry]
            one = Turning(entry, sides1[2, entry], sides1[3, entry], sides1[4, entry])
            for exit_ in range(len(times2)):
                two = Turning(exit_, sides2[2, exit_], sides2[3, exit_], sides2[4, exit_])
                straight = times1[entry] + times2[exit_]
                if straight + turn_time(abs(total), max(one.rate, two.rate), rates.aw) > longest:
                    continue
                gaps2, drives2 = afters[0, exit_], afters[1, exit_]
                ahead = x - sides1[0, entry] - sides2[0, exit_] * cos
                aside = y - sides2[0, exit_] * sin
                for root in range(_find_steps(steps, gaps1, gaps2)):
                    step = steps[root]
                    gap = gaps1[step] + gaps2[step]
                    share = gap / (gap - gaps1[step + 1] - gaps2[step + 1])
                    drive = (1.0 - share) * (drives1[step] + drives2[step])
                    drive += share * (drives1[step + 1] + drives2[step + 1])
                    if not drive >= least_slack - _APPROXIMATE:  # or it is NaN
                        continue
                    first = _GRID[step] + share * _GRID_STEP
                    first, c, s = refined(
                        first, _GRID[step], _GRID[step + 1], gap, total, ahead, aside, one, two,
                        across1, across2,
                    )  # fmt: skip
                    last = total - first
                    time1 = turn_time(abs(first), one.rate, rates.aw)
                    time2 = turn_time(abs(last), two.rate, rates.aw)
                    lane = c * ahead + s * aside - one.speed * time1 - two.speed * time2
                    drive = drive_length(lane, first, last, entry, exit_, along1, along2)
                    before = speed_after(one.speed, one.change, time1, rates.v)
                    after = speed_after(two.speed, two.change, time2, rates.v)
                    time = straight + time1 + time2 + drive_time(drive, before, after, rates)
                    if drive - change_distance(before, after, rates) < least_slack or time > longest:
                        continue
                    if count == len(found):
                        shorter, found = found, np.empty((2 * count, 6))
                        found[:count] = shorter
                    found[count, 0], found[count, 1], found[count, 2] = time, entry, exit_
                    found[count, 3], found[count, 4], found[count, 5] = first, last, drive
                    count += 1
    return found[:count]


@compiled
def _fill_befores(befores: NDArray[np.float32], x: float, y: float, entries: Ends, aw: float) -> None:
    """Write how far to the left of the end of each entry, and ahead, the goal (x, y) lies, in m.

    Ahead, the distance counts that its turn adds to its time at the speed at which it begins.
    """
    (along, across), sides = entries.turns, entries.sides
    for entry in range(befores.shape[1]):
        ahead, row = x - sides[0, entry], entry * ENTRIES + EDGE - _STRIDE * (_POINTS // 2)
        for step in range(_POINTS):
            at, coasted = row + _STRIDE * step, sides[2, entry] * turn_time(_GRID[step], sides[4, entry], aw)
            befores[0, entry, step] = _COS[step] * y - _SIN[step] * ahead - across[at]
            befores[1, entry, step] = _COS[step] * ahead + _SIN[step] * y - along[at] - coasted


@compiled
def _fill_afters(afters: NDArray[np.float32], total: float, exits: Ends, aw: float) -> None:
    """Write how far to the left of the goal each exit begins, and ahead, in m; NaN if its turn is too wide.

    Each of `total` (rad), by which the heading changes in all, is turned first by one of the first turns.
    """
    (along, across), sides = exits.turns, exits.sides
    for step in range(_POINTS):
        angle = _GRID[step] - total
        if not abs(angle) < WIDEST:
            afters[0, :, step] = np.nan
            continue
        cos, sin = math.cos(angle), math.sin(angle)
        for exit_ in range(afters.shape[1]):
            low, share = place_of(exit_, angle)
            length, coasted = sides[0, exit_], sides[2, exit_] * turn_time(angle, sides[4, exit_], aw)
            afters[0, exit_, step] = length * sin - look_up(across, low, share)
            afters[1, exit_, step] = -length * cos - look_up(along, low, share) - coasted


@compiled
def _find_steps(steps: NDArray[np.intp], before: NDArray[np.float32], after: NDArray[np.float32]) -> int:
    """Write the steps of the grid in which the sign of `before + after` changes; return their number."""
    count = 0
    end = before[_POINTS - 1] + after[_POINTS - 1] > np.float32(0.0)
    for word in range(_WORDS - 1, -1, -1):
        above = np.uint32(0)
        for bit in range(_WORD):
            step = word * _WORD + bit
            above |= _BITS[bit] if before[step] + after[step] > np.float32(0.0) else np.uint32(0)
        signs = np.int64(above) | (np.int64(end) << _WORD)
        changes = (signs ^ (signs >> 1)) & _ALL
        while changes:
            steps[count] = word * _WORD + math.frexp(float(changes & -changes))[1] - 1
            changes &= changes - 1
            count += 1
        end = bool(above & 1)
    return count


@compiled
def refined(
    first: float,
    low: float,
    high: float,
    gap: float,
    total: float,
    ahead: float,
    aside: float,
    one: Turning,
    two: Turning,
    across1: FloatArray,
    across2: FloatArray,
) -> tuple[float, float, float]:
    """Return a first turn (rad) after which the drive meets the last turn, its cosine and sine.

    It does one secant step from `first`, within `low` and `high`. `gap` (m) is the residual at `low`: how far
    the drive passes the end of the last turn on the right. The last turn ends `ahead` m and `aside` m from
    where the first one begins.
    """
    c, s = math.cos(first), math.sin(first)
    begin, share1 = place_of(one.row, first)
    end, share2 = place_of(two.row, first - total)  # the last turn is driven from the goal
    now = c * aside - s * ahead - look_up(across1, begin, share1) - look_up(across2, end, share2)
    if now != gap:
        change = min(max(now * (first - low) / (gap - now), low - first), high - first)
        square = change * change
        cos, sin = 1.0 - 0.5 * square, change * (1.0 - square * (1.0 / 6.0))
        first, c, s = first + change, c * cos - s * sin, s * cos + c * sin
    return first, c, s


@inlined
def speed_after(speed: float, change: float, time: float, v: float) -> float:
    """Return the speed (m/s) after a turn of `time` s that begins at `speed`, within the limit `v`."""
    return min(max(speed + change * time, -v), v)


@inlined
def drive_length(
    lane: float, first: float, last: float, row1: int, row2: int, along1: FloatArray, along2: FloatArray
) -> float:
    """Return the length in m of the drive between two turns (rad), whose rows in the tables are given.

    `lane` is how far in m the end of the last turn lies ahead in the direction of the drive, less what the
    robot drives in the times of the turns at the speeds at which they begin.
    """
    begin, share1 = place_of(row1, first)
    end, share2 = place_of(row2, -last)  # the last turn is driven from the goal
    return lane - look_up(along1, begin, share1) - look_up(along2, end, share2)
