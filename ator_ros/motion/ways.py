"""The ways to drive both ends of a manoeuvre, as arrays: where they lead, and how long they take at least."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.motion.displacements import TurnDriving, displacement_table
from ator_ros.motion.durations import drive_time, turn_time
from ator_ros.motion.manoeuvre import Side, side_table
from ator_ros.motion.planning import Planning
from ator_ros.robot.description import Limits

STEP = math.radians(5.0)
HALF = 54
"""Turns of up to 270 degrees either way."""
GRID: FloatArray = STEP * np.arange(-HALF, HALF + 1, dtype=float)
# The turn into the goal is looked up between grid points, so its table is one step wider.
_WIDE_GRID: FloatArray = STEP * np.arange(-HALF - 1, HALF + 2, dtype=float)
_SIDES_A_POINT = 6


@dataclass(frozen=True, slots=True)
class Ways:
    """Sides that can be combined.

    Attributes
    ----------
    entry_sides, exit_sides : sequence of Side
        How both ends may be driven.
    entry_table, exit_table : ndarray, shape (5, sides)
        Their numbers, as in `Bundle`.
    along, across : ndarray, shape (entries, grid)
        The entry's displacement along and across the straight drive in m, for first turns on `GRID`.
    exit_places : ndarray, shape (exits, 2, grid + 2)
        Where the turns of the exits end, without their straight stretch.
    entry_stretches, exit_stretches : ndarray, shape (sides,)
        Times of the straight stretches in s.
    entry_least : ndarray, shape (entries, grid - 1)
        `least_times` of the entries.
    soonest : ndarray, shape (grid - 1,)
        The least of them.
    entry_shortest : ndarray, shape (entries, grid - 1)
        The lesser `along` of both ends of each step.
    shortest : ndarray, shape (grid - 1,)
        The least of them.
    forward : bool
        Whether no side drives backward: no speed is negative, and none falls from the outside inward.
    """

    entry_sides: Sequence[Side]
    exit_sides: Sequence[Side]
    limits: Limits
    entry_table: FloatArray
    exit_table: FloatArray
    along: FloatArray
    across: FloatArray
    exit_places: FloatArray
    entry_stretches: FloatArray
    exit_stretches: FloatArray
    entry_least: FloatArray
    soonest: FloatArray
    entry_shortest: FloatArray
    shortest: FloatArray
    forward: bool


def ways_to_drive(entries: Sequence[Side], exits: Sequence[Side], limits: Limits) -> Planning[Ways]:
    """Prepare to search with these sides."""
    # Tables that happen to be there cost the same: what was planned before must not decide how slices end.
    yield 2 + (len(entries) + len(exits)) // _SIDES_A_POINT
    sides = side_table(entries), side_table(exits)
    along, across = _entry_parts(tuple(entries), limits)
    stretches = drive_time(sides[0][0], sides[0][1], sides[0][2], limits)
    least = least_times(sides[0], stretches, GRID, along, limits)
    shortest = np.minimum(along[:, 1:], along[:, :-1])
    return Ways(
        entries,
        exits,
        limits,
        *sides,
        along,
        across,
        _exit_places(tuple(exits), limits),
        stretches,
        drive_time(sides[1][0], sides[1][2], sides[1][1], limits),
        least,
        least.min(axis=0),
        shortest,
        shortest.min(axis=0),
        bool(min(table[2:4].min() for table in sides) >= 0.0),
    )


def least_times(
    table: FloatArray, stretches: FloatArray, turns: FloatArray, along: FloatArray, limits: Limits
) -> FloatArray:
    """Return what each side takes at least between two neighbouring turns, shape (sides, n - 1), in s.

    A time counts from when the robot would have begun to cover the side's own part of the drive's direction,
    `along` (m), shape (sides, n), at full speed. `turns` (rad), shape (n,), are a `STEP` apart.
    """
    least = np.maximum(0.0, np.abs(turns[1:] + turns[:-1]) / 2.0 - STEP / 2.0)
    covered = np.maximum(along[:, 1:], along[:, :-1]) / limits.v
    return stretches[:, None] + turn_time(least, table[4][:, None], limits.aw) - covered


@lru_cache(maxsize=16)
def _entry_parts(sides: tuple[Side, ...], limits: Limits) -> tuple[FloatArray, FloatArray]:
    table = _table(GRID, sides, limits)
    x = table[:, 0] + np.array([[side.length] for side in sides])
    y = table[:, 1]
    c, s = np.cos(GRID), np.sin(GRID)
    along, across = c * x + s * y, c * y - s * x
    along.setflags(write=False)
    across.setflags(write=False)
    return along, across


@lru_cache(maxsize=16)
def _exit_places(sides: tuple[Side, ...], limits: Limits) -> FloatArray:
    places = _table(_WIDE_GRID, sides, limits)
    places.setflags(write=False)
    return places


def _table(angles: FloatArray, sides: Sequence[Side], limits: Limits) -> FloatArray:
    """Compute where turns end; those at the outer speed, of which there are many, are not stored."""
    own = np.array([side.turn.speed == side.outer_speed for side in sides])
    table = np.empty((len(sides), 2, len(angles)))
    turns = [side.turn for side in sides]
    if own.any():
        table[own] = displacement_table(angles, list(itertools.compress(turns, own)), limits)
    if not own.all():
        table[~own] = _stored_table(angles.tobytes(), tuple(itertools.compress(turns, ~own)), limits)
    return table


@lru_cache(maxsize=64)
def _stored_table(angles: bytes, turns: tuple[TurnDriving, ...], limits: Limits) -> FloatArray:
    return displacement_table(np.frombuffer(angles), turns, limits)
