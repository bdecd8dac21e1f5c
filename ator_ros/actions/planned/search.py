"""The search for the fastest manoeuvre between two poses: every combination of two sides, all at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ator_ros.actions.planned.bundle import Bundle, side_table
from ator_ros.actions.planned.manoeuvre import Manoeuvre, Side
from ator_ros.actions.planned.planning import Planning
from ator_ros.actions.planned.profiles import speed_change_distances, straight_times, turn_times
from ator_ros.actions.planned.turns import displacement_table, speeds_after
from ator_ros.geometry import FloatArray, Pose
from ator_ros.robot import Limits

_Parts: TypeAlias = tuple[FloatArray, FloatArray]
_STEP = math.radians(5.0)
_HALF = 54  # turns of up to 270 degrees either way
_GRID: FloatArray = _STEP * np.arange(-_HALF, _HALF + 1, dtype=float)
BEGIN_POINTS = 5
"""What it costs to begin a search, in points of planning; see `planning`."""
RANK_POINTS = 3
"""What it costs at least to rank what was found."""
_WAYS_A_POINT = 4
_BRACKETS_A_POINT = 60_000
_CANDIDATES_A_POINT = 500
# The turn into the goal is looked up between grid points, so its table is one step wider.
_WIDE_GRID: FloatArray = _STEP * np.arange(-_HALF - 1, _HALF + 2, dtype=float)


@dataclass(frozen=True, slots=True)
class Candidates:
    """Manoeuvres found between two poses, fastest first.

    Attributes
    ----------
    entries, exits : ndarray of int, shape (n,)
        Which sides they combine.
    first, last, distance, times : ndarray, shape (n,)
        Turns in rad, straight drive in m, durations in s (to the grid's accuracy).
    entry_table, exit_table : ndarray, shape (5, sides)
        The numbers of the sides, as in `Bundle`.
    slack : ndarray, shape (n,)
        How much longer the drive is than its change of speed needs, in m; negative: it overshoots.
    """

    start: Pose
    goal: Pose
    limits: Limits
    entry_sides: Sequence[Side]
    exit_sides: Sequence[Side]
    entries: NDArray[np.intp]
    exits: NDArray[np.intp]
    first: FloatArray
    last: FloatArray
    distance: FloatArray
    times: FloatArray
    slack: FloatArray
    entry_table: FloatArray
    exit_table: FloatArray

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, index: int) -> Manoeuvre:
        return Manoeuvre(
            self.start,
            self.goal,
            self.entry_sides[self.entries[index]],
            self.exit_sides[self.exits[index]],
            float(self.first[index]),
            float(self.last[index]),
            float(self.distance[index]),
            self.limits,
        )

    def bundle(self, which: NDArray[np.intp]) -> Bundle:
        """Return the manoeuvres of the indices `which`, shape (n,)."""
        return Bundle(
            self.start,
            np.repeat(np.array(self.goal)[:, None], len(which), axis=1),
            self.entry_table[:, self.entries[which]],
            self.exit_table[:, self.exits[which]],
            self.first[which],
            self.last[which],
            self.distance[which],
            self.limits,
        )


def find_candidates(
    start: Pose,
    goal: Pose,
    entry_sides: Sequence[Side],
    exit_sides: Sequence[Side],
    limits: Limits,
    least_slack: float = -math.inf,
    longest: float = math.inf,
) -> Planning[Candidates]:
    """Find all manoeuvres from `start` to `goal` that the sides allow.

    For each pair of sides the heading of the straight drive is the only unknown: the drive must meet the
    last turn. Its roots are bracketed on a grid of first turns, where the parts of both sides just add.
    Those with less slack than `least_slack` (m) are left out, and most of those that take more than
    `longest` s: turns that alone take longer are not tried.
    """
    # Tables that happen to be there cost the same: what was planned before must not decide how slices end.
    yield BEGIN_POINTS + (len(entry_sides) + len(exit_sides)) // _WAYS_A_POINT
    offset = start.relative(goal)
    along, across = _entry_parts(tuple(entry_sides), limits)
    exit_table = _exit_table(tuple(exit_sides), limits)
    lanes = np.stack((offset.x * np.cos(_GRID) + offset.y * np.sin(_GRID),
                      offset.y * np.cos(_GRID) - offset.x * np.sin(_GRID)))  # fmt: skip
    found = []
    rates = tuple(max(side.turn.turn_rate for side in sides) for sides in (entry_sides, exit_sides))
    for turn in (offset.yaw - 2.0 * math.pi, offset.yaw, offset.yaw + 2.0 * math.pi):
        tried = _window(turn, rates, longest)
        if tried is None:
            continue
        pairs = len(entry_sides) * len(exit_sides) * (tried[1] - tried[0])
        yield 1 + len(exit_sides) // _WAYS_A_POINT + pairs // _BRACKETS_A_POINT
        window, exit_along, exit_across = _exit_parts(exit_sides, exit_table, turn, tried)
        sideways = lanes[1, window] - across[:, window], exit_across
        drive = lanes[0, window] - along[:, window], exit_along
        found.append(_roots(sideways, drive, _GRID[window], turn))
    nothing = np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), *(np.zeros(0),) * 3
    yield RANK_POINTS + sum(len(roots[0]) for roots in found) // _CANDIDATES_A_POINT
    return _ranked(
        start, goal, entry_sides, exit_sides, limits, least_slack,
        [np.concatenate(x) for x in zip(*(found or [nothing]), strict=True)],
    )  # fmt: skip


def _window(turn: float, rates: Sequence[float], longest: float) -> tuple[int, int] | None:
    """Return the least and greatest first turn, in grid steps, of manoeuvres of up to `longest` s.

    The two turns, `turn` rad in all, take at least their angles divided by the greatest `rates` (rad/s).
    None where all take longer.
    """
    base = math.floor(-turn / _STEP)
    low, high = max(-_HALF, -_HALF - 1 - base), min(_HALF, _HALF - base)
    if math.isinf(longest):
        return low, high
    first = _STEP * np.arange(low, high + 1)
    least = np.abs(first) / rates[0] + np.abs(turn - first) / rates[1]
    # Between two grid points it may be faster by half a step's turn; a root needs the points around it.
    able = np.flatnonzero(least <= longest + _STEP / min(rates))
    if not len(able):
        return None
    return max(low, low + int(able[0]) - 1), min(high, low + int(able[-1]) + 1)


@lru_cache(maxsize=16)
def _entry_parts(sides: tuple[Side, ...], limits: Limits) -> tuple[FloatArray, FloatArray]:
    """Compute the entry's displacement along and across the straight drive, shapes (sides, grid)."""
    table = displacement_table(_GRID, [side.turn for side in sides], limits)
    x = table[:, 0] + np.array([[side.length] for side in sides])
    y = table[:, 1]
    c, s = np.cos(_GRID), np.sin(_GRID)
    along, across = c * x + s * y, c * y - s * x
    along.setflags(write=False)
    across.setflags(write=False)
    return along, across


@lru_cache(maxsize=16)
def _exit_table(sides: tuple[Side, ...], limits: Limits) -> FloatArray:
    table = displacement_table(_WIDE_GRID, [side.turn for side in sides], limits)
    table.setflags(write=False)
    return table


def _exit_parts(
    sides: Sequence[Side], table: FloatArray, turn: float, tried: tuple[int, int]
) -> tuple[slice, FloatArray, FloatArray]:
    """Return the exit's displacement along and across the drive, with the window of the grid it is for.

    `turn` is the whole change of heading in rad, at most three half turns; the last turn is what the
    first leaves of it, and `tried` are the least and greatest first turn, which leave one in range.
    """
    # last = turn - first; looked up at -last = first - turn, a constant fraction between grid points.
    shift = -turn / _STEP
    base = math.floor(shift)
    fraction = shift - base
    low, high = tried
    at = slice(low + base + _HALF + 1, high + base + _HALF + 2)
    after = slice(at.start + 1, at.stop + 1)
    x, y = np.moveaxis((1.0 - fraction) * table[:, :, at] + fraction * table[:, :, after], 1, 0)
    x = x + np.array([[side.length] for side in sides])
    window = slice(low + _HALF, high + _HALF + 1)
    # The displacement is given in the goal's frame; the drive's heading in it is first - turn.
    c, s = np.cos(_GRID[window] - turn), np.sin(_GRID[window] - turn)
    return window, c * x + s * y, c * y - s * x


def _roots(sideways: _Parts, drive: _Parts, grid: FloatArray, turn: float) -> tuple[NDArray[Any], ...]:
    """Bracket the first turns at which both sides agree on the drive's lane, and interpolate.

    Parameters
    ----------
    sideways, drive : pair of ndarray, shapes (entries, grid) and (exits, grid)
        Where the drive lies and how long it is, each the entry's part minus the exit's, in m.
    """
    # The sign of each difference is all that most pairs need: no array of the differences is made.
    right_of = sideways[0][:, None] <= sideways[1]
    changes = right_of[..., :-1] != right_of[..., 1:]
    pairs, index = np.divmod(np.flatnonzero(changes), changes.shape[2])
    entries, exits = np.divmod(pairs, changes.shape[1])

    def differences(parts: _Parts, at: NDArray[np.intp]) -> FloatArray:
        return np.asarray(parts[0][entries, at] - parts[1][exits, at])

    left, right = differences(sideways, index), differences(sideways, index + 1)
    share = left / (left - right)
    first = grid[index] + share * _STEP
    distance = (1.0 - share) * differences(drive, index) + share * differences(drive, index + 1)
    return entries, exits, first, turn - first, distance


def _ranked(
    start: Pose, goal: Pose, entry_sides: Sequence[Side], exit_sides: Sequence[Side], limits: Limits,
    least_slack: float, found: list[NDArray[Any]],
) -> Candidates:  # fmt: skip
    sides = side_table(entry_sides), side_table(exit_sides)
    times, speeds, stretches = [], [], []
    for side, (begin, end) in enumerate(((1, 2), (2, 1))):
        stretch = sides[side]
        speed, acceleration, rate = (row[found[side]] for row in stretch[2:])
        times.append(turn_times(found[2 + side], rate, limits.aw))
        speeds.append(speeds_after(speed, acceleration, times[side], limits.v))
        stretches.append(straight_times(stretch[0], stretch[begin], stretch[end], limits))
    slack = found[4] - speed_change_distances(*speeds, limits)
    kept = np.flatnonzero(slack >= least_slack)
    found, slack = [column[kept] for column in found], slack[kept]
    durations = np.zeros(len(kept))
    for side in (0, 1):
        durations += times[side][kept] + stretches[side][found[side]]
    durations += straight_times(found[4], speeds[0][kept], speeds[1][kept], limits)
    order = np.argsort(durations, kind="stable")
    entries, exits, first, last, distance = (column[order] for column in found)
    return Candidates(
        start, goal, limits, entry_sides, exit_sides, entries, exits,
        first, last, distance, durations[order], slack[order], *sides,
    )  # fmt: skip
