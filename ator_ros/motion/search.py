"""The search for the fastest manoeuvre between two poses, over all combinations of entries and exits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.displacements import displacement_table, speeds_after
from ator_ros.motion.durations import change_distance, drive_time, turn_time
from ator_ros.motion.manoeuvre import Bundle, Side, side_table
from ator_ros.motion.planning import Planning
from ator_ros.robot.description import Limits

STEP = math.radians(5.0)
HALF = 54
"""Turns of up to 270 degrees either way."""
GRID: FloatArray = STEP * np.arange(-HALF, HALF + 1, dtype=float)
# The turn into the goal is looked up between grid points, so its table is one step wider.
_WIDE_GRID: FloatArray = STEP * np.arange(-HALF - 1, HALF + 2, dtype=float)
_SIDES_A_POINT = 6


class Ends(NamedTuple):
    """Ways to drive one end of a manoeuvre.

    Attributes
    ----------
    table : ndarray, shape (5, n)
        The n candidates, as in `Bundle`.
    straight_times : ndarray, shape (n,)
        Times of the straight parts in s.
    """

    table: FloatArray
    straight_times: FloatArray


@dataclass(frozen=True, slots=True)
class SearchTables:
    """The entries and exits of a search, with precomputed displacements and times.

    Attributes
    ----------
    along, across : ndarray, shape (entries, grid)
        The entry's displacement along and across the straight drive in m, for first turns on `GRID`.
    exit_places : ndarray, shape (exits, 2, grid + 2)
        Where the turns of the exits end, without their straight part.
    entry_least : ndarray, shape (entries, grid - 1)
        Lower bounds of the entries' times; see `_least_times`.
    forward : bool
        Whether no side drives backward: no speed is negative or decreases inward.
    """

    entries: Ends
    exits: Ends
    limits: Limits
    along: FloatArray
    across: FloatArray
    exit_places: FloatArray
    entry_least: FloatArray
    forward: bool


def search_tables(entries: Sequence[Side], exits: Sequence[Side], limits: Limits) -> Planning[SearchTables]:
    """Compute the tables of a search with these sides."""
    # Cached tables cost the same points, so that earlier plans do not change where slices end.
    yield 2 + (len(entries) + len(exits)) // _SIDES_A_POINT
    first, last = side_table(entries), side_table(exits)
    x, y = np.moveaxis(displacement_table(GRID, [side.turn for side in entries], limits), 1, 0)
    x = x + first[0][:, None]
    c, s = np.cos(GRID), np.sin(GRID)
    along, across = c * x + s * y, c * y - s * x
    starts = Ends(first, drive_time(first[0], first[1], first[2], limits))
    return SearchTables(
        starts,
        Ends(last, drive_time(last[0], last[2], last[1], limits)),
        limits,
        along,
        across,
        displacement_table(_WIDE_GRID, [side.turn for side in exits], limits),
        _least_times(starts, GRID, along, limits),
        bool(min(first[2:4].min(), last[2:4].min()) >= 0.0),
    )


def _least_times(ends: Ends, turns: FloatArray, along: FloatArray, limits: Limits) -> FloatArray:
    """Return lower bounds in s of each side's time between two neighboring turns, shape (sides, n - 1).

    The time at full speed for the side's own displacement `along` the drive (m), shape (sides, n), is
    subtracted. `turns` (rad), shape (n,), are a `STEP` apart.
    """
    least = np.maximum(0.0, np.abs(turns[1:] + turns[:-1]) / 2.0 - STEP / 2.0)
    covered = np.maximum(along[:, 1:], along[:, :-1]) / limits.v
    return ends.straight_times[:, None] + turn_time(least, ends.table[4][:, None], limits.aw) - covered


_Parts: TypeAlias = tuple[FloatArray, FloatArray]
_RANK_POINTS = 4
"""Least cost of ranking candidates in points; see `planning`."""
_BRACKETS_A_POINT = 50_000
_CANDIDATES_A_POINT = 800
_ROUNDING = 1e-9  # s


def find_candidates(
    start: Pose, goal: Pose, tables: SearchTables, least_slack: float = -math.inf, longest: float = math.inf
) -> Planning[tuple[Bundle, FloatArray]]:
    """Find all manoeuvres from `start` to `goal` with the sides of `tables`, fastest first.

    For each pair of sides the heading of the straight drive is the only unknown: the drive must meet the
    last turn. Its roots are bracketed on a grid of first turns, where the parts of both sides just add.
    Manoeuvres with less slack than `least_slack` (m) are left out, and most that take more than `longest` s.

    Returns
    -------
    found : Bundle
        The manoeuvres.
    times : ndarray, shape (n,)
        Their durations in s, to the grid's accuracy.
    """
    offset = start.relative(goal)
    lanes = np.stack((offset.x * np.cos(GRID) + offset.y * np.sin(GRID),
                      offset.y * np.cos(GRID) - offset.x * np.sin(GRID)))  # fmt: skip
    none, empty = np.zeros(0, dtype=np.intp), np.zeros(0)
    found: list[tuple[NDArray[Any], ...]] = [(none, none, empty, empty, empty)]
    # If the robot only drives forward, drives that are too short for their change of speed are not ranked.
    least_drive = least_slack if tables.forward else -math.inf
    fastest_turn = max(tables.entries.table[4].max(), tables.exits.table[4].max())
    for turn in (offset.yaw - 2.0 * math.pi, offset.yaw, offset.yaw + 2.0 * math.pi):
        if abs(turn) > longest * fastest_turn:
            continue
        yield 1
        parts = _exit_parts(tables, turn)
        tried = _tried(tables, turn, lanes[0], parts, longest, least_drive)
        if tried is None:
            continue
        entries, exits, low, high = tried
        yield 3 + len(entries) * len(exits) * (high - low) // _BRACKETS_A_POINT
        on_grid, on_parts = slice(low, high), slice(low - parts.low, high - parts.low)
        sideways = lanes[1, on_grid] - tables.across[entries, on_grid], parts.across[exits, on_parts]
        drive = lanes[0, on_grid] - tables.along[entries, on_grid], parts.along[exits, on_parts]
        first_of, last_of, *numbers = _roots(sideways, drive, GRID[on_grid], turn, least_drive)
        found.append((entries[first_of], exits[last_of], *numbers))
    columns = [np.concatenate(column) for column in zip(*found, strict=True)]
    if len(columns[0]):
        yield _RANK_POINTS + len(columns[0]) // _CANDIDATES_A_POINT
    return _ranked(goal, tables, least_slack, columns)


class _ExitParts(NamedTuple):
    """The exits' displacement along and across the drive, (exits, n), from the grid point `low` on."""

    low: int
    along: FloatArray
    across: FloatArray


def _exit_parts(tables: SearchTables, turn: float) -> _ExitParts:
    """Compute what the exits add to a drive where the heading changes by `turn` in rad, up to 1.5 turns."""
    # last = turn - first; looked up at -last = first - turn, a constant fraction between grid points.
    shift = -turn / STEP
    base = math.floor(shift)
    fraction = shift - base
    low, high = max(-HALF, -HALF - 1 - base), min(HALF, HALF - base)
    at = slice(low + base + HALF + 1, high + base + HALF + 2)
    after = slice(at.start + 1, at.stop + 1)
    places = tables.exit_places
    x, y = np.moveaxis((1.0 - fraction) * places[:, :, at] + fraction * places[:, :, after], 1, 0)
    x = x + tables.exits.table[0][:, None]
    # The displacement is given in the goal's frame; the drive's heading in it is first - turn.
    headings = GRID[low + HALF : high + HALF + 1] - turn
    c, s = np.cos(headings), np.sin(headings)
    return _ExitParts(low + HALF, c * x + s * y, c * y - s * x)


def _tried(
    tables: SearchTables, turn: float, lane: FloatArray, parts: _ExitParts, longest: float, least_drive: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], int, int] | None:
    """Return the entries, exits and grid range in which manoeuvres of up to `longest` s can lie.

    `lane`, shape (grid,), is how far the goal lies ahead in the drive's direction in m, `least_drive` the
    shortest drive in m. None if there can be no such manoeuvre.
    """
    low, high = parts.low, parts.low + parts.along.shape[1]
    entries, exits = np.arange(tables.entries.table.shape[1]), np.arange(tables.exits.table.shape[1])
    if math.isinf(longest):
        return entries, exits, low, high
    here, limits = slice(low, high - 1), tables.limits
    # Bounds add up from those of both ends, between each two points of the grid; shapes (sides, steps).
    after = _least_times(tables.exits, turn - GRID[low:high], parts.along, limits)
    left = longest + _ROUNDING - np.minimum(lane[here], lane[low + 1 : high]) / limits.v
    room = np.maximum(lane[here], lane[low + 1 : high]) - least_drive + _ROUNDING
    before, entry_shortest = tables.entry_least[:, here], _shortest(tables.along[:, low:high])
    exit_shortest = _shortest(parts.along)
    fit = (after <= left - before.min(axis=0)) & (exit_shortest <= room - entry_shortest.min(axis=0))
    able = np.flatnonzero(fit.any(axis=0))
    if not len(able):
        return None
    used = slice(int(able[0]), int(able[-1]) + 1)
    exits = np.flatnonzero(fit.any(axis=1))
    left, room = left - after.min(axis=0), room - exit_shortest.min(axis=0)
    fit = (before[:, used] <= left[used]) & (entry_shortest[:, used] <= room[used])
    return np.flatnonzero(fit.any(axis=1)), exits, low + used.start, low + used.stop + 1


def _shortest(along: FloatArray) -> FloatArray:
    """Return the lesser displacement along the drive of both ends of each step of the grid."""
    return np.minimum(along[:, 1:], along[:, :-1])


def _roots(
    sideways: _Parts, drive: _Parts, grid: FloatArray, turn: float, least_drive: float
) -> tuple[NDArray[Any], ...]:
    """Bracket the first turns at which both sides agree on the drive's lane, and interpolate.

    `sideways` and `drive`: where the drive lies and how long it is, each the entry's part, (entries, grid),
    minus the exit's, (exits, grid), in m. Shorter drives than `least_drive` are left out.
    """
    # Most pairs need only the sign of their difference, so no array of differences is made.
    right_of = sideways[0][:, None] <= sideways[1]
    changes = right_of[..., :-1] != right_of[..., 1:]
    pairs, index = np.divmod(np.flatnonzero(changes), changes.shape[2])
    entries, exits = np.divmod(pairs, changes.shape[1])

    def differences(parts: _Parts, at: NDArray[np.intp]) -> FloatArray:
        return np.asarray(parts[0][entries, at] - parts[1][exits, at])

    left, right = differences(sideways, index), differences(sideways, index + 1)
    share = left / (left - right)
    first = grid[index] + share * STEP
    distance = (1.0 - share) * differences(drive, index) + share * differences(drive, index + 1)
    if least_drive > -math.inf:
        long = np.flatnonzero(distance >= least_drive)
        entries, exits, first, distance = entries[long], exits[long], first[long], distance[long]
    return entries, exits, first, turn - first, distance


def _ranked(
    goal: Pose, tables: SearchTables, least_slack: float, found: list[NDArray[Any]]
) -> tuple[Bundle, FloatArray]:
    limits, ends = tables.limits, (tables.entries, tables.exits)
    times, speeds = [], []
    for side, end in enumerate(ends):
        speed, acceleration, rate = (row[found[side]] for row in end.table[2:])
        times.append(turn_time(found[2 + side], rate, limits.aw))
        speeds.append(speeds_after(speed, acceleration, times[side], limits.v))
    slack = found[4] - change_distance(speeds[0], speeds[1], limits)
    kept = np.flatnonzero(slack >= least_slack)
    found = [column[kept] for column in found]
    durations = np.zeros(len(kept))
    for side, end in enumerate(ends):
        durations += times[side][kept] + end.straight_times[found[side]]
    durations += drive_time(found[4], speeds[0][kept], speeds[1][kept], limits)
    order = np.argsort(durations, kind="stable")
    entries, exits, first, last, distance = (column[order] for column in found)
    goals = np.repeat(np.array(goal)[:, None], len(order), axis=1)
    sides = tables.entries.table[:, entries], tables.exits.table[:, exits]
    return Bundle(goals, *sides, first, last, distance), durations[order]
