"""Turn-drive-turn paths, and the search for all of them between two poses.

The heading of the drive is the only unknown: the drive must end where the last turn begins. Its
roots are bracketed on a grid of first turns, where the lateral offsets of both turns, which tables
hold, just add. Plans choose among all paths; features are times of the fastest
(`ator_ros.bases.differential.shapes`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.bases.differential.durations import (
    Rates,
    change_distance,
    drive_time,
    rates_of,
    turn_time,
)
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.manoeuvre import SIDE, Side
from ator_ros.bases.differential.turns import STEP, WIDEST, TurnTable, look_up, turn_table
from ator_ros.compiled import compiled, inlined
from ator_ros.geometry import FloatArray, Pose, Records, record_type

RealArray = NDArray[np.floating[Any]]

WIDTH = 32
"""Turns of a grid whose gaps are compared at once: whole vectors."""
_BITS = (1 << np.arange(WIDTH)).astype(np.uint32)
_DE_BRUIJN = 0x077CB531
_PLACES = np.argsort([(_DE_BRUIJN << place >> 27) & 31 for place in range(WIDTH)])
"""Places of bits by their products with a sequence of bits in which every five are different."""
_POINTS = 3 * WIDTH + 1
_GRID_STEP = STEP / 4
_GRID: FloatArray = _GRID_STEP * (np.arange(_POINTS, dtype=float) - _POINTS // 2)
"""First turns of up to 270 degrees in either direction."""


class Turn(NamedTuple):
    """A turn next to the drive of a path, as seen from its end of the path."""

    speed: float  # m/s; at its beginning
    change: float  # m/s^2; of the speed
    time: float  # s
    along: float  # m; displacement along the drive, as in a `TurnTable`


class Offset(NamedTuple):
    """The vector in m from the beginning of the first turn to the end of the last one."""

    x: float
    y: float
    before: float  # m by which the drive ends before the last turn begins


@inlined
def sign_bit(gap: float, step: int) -> np.uint32:
    """Return the bit that `crossings` expects of a step where the gap is above zero, else 0."""
    return _BITS[step] if gap > np.float32(0.0) else np.uint32(0)


@inlined
def crossings(above: int, steps: int, both: bool) -> int:
    """Return a number whose bits mark those of the first steps in which the gap changes its sign.

    The gap is how far the drive passes the last turn on the right. Where it falls through zero the
    drive goes forward, else backward, which counts only if `both` do.
    """
    changes = (above ^ (above >> 1)) & ((1 << steps) - 1)
    return changes if both else changes & above


@inlined
def lowest(bits: int) -> int:
    """Return the place of the lowest bit that is set."""
    place: int = _PLACES[((bits & -bits) * _DE_BRUIJN >> 27) & 31]
    return place


@inlined
def drive_between(
    one: Turn,
    two: Turn,
    cos: float,
    sin: float,
    offset: Offset,
    rates: Rates,
) -> tuple[float, float, float]:
    """Return the length (m; negative: backward) of the drive between two turns, and its end speeds.

    `cos` and `sin` are those of its heading.
    """
    lane = (
        cos * offset.x
        + sin * offset.y
        - offset.before
        - one.speed * one.time
        - two.speed * two.time
    )
    length = lane - one.along - two.along
    before = min(max(one.speed + one.change * one.time, -rates.v), rates.v)
    after = min(max(two.speed + two.change * two.time, -rates.v), rates.v)
    return length, before, after


class Ends(NamedTuple):
    """Candidates for one end of a path."""

    sides: Records  # shape (n,), of `SIDE`
    times: FloatArray  # s, shape (n,); of the straight parts
    turns: TurnTable  # displacements by their turns


def entries_of(sides: Sequence[Side], limits: Limits) -> Ends:
    """Return candidates for the start of paths: straight to the turn's speed, then the turn."""
    rows = _rows(sides)
    times = drive_time(rows["length"], rows["outer_speed"], rows["speed"], limits)
    return Ends(rows, times, _turns_of(rows, limits))


def exits_of(sides: Sequence[Side], limits: Limits) -> Ends:
    """Return candidates for the end of paths, seen from the goal: a turn, then straight to it."""
    rows = _rows(sides)
    times = drive_time(rows["length"], rows["speed"], rows["outer_speed"], limits)
    return Ends(rows, times, _turns_of(rows, limits))


def _rows(sides: Sequence[Side]) -> Records:
    """Return the sides as records, those with the same turn rate together."""
    return np.array(sorted(sides, key=lambda side: side.rate), dtype=SIDE)


def _turns_of(rows: Records, limits: Limits) -> TurnTable:
    return turn_table(np.stack([rows["speed"], rows["change"], rows["rate"]], axis=1), limits)


PATH = record_type(
    [
        ("time", float),  # s; duration
        ("entry", np.intp),  # index of its candidate
        ("exit", np.intp),
        ("first", float),  # rad; the first turn
        ("last", float),  # rad; the last turn
        ("drive", float),  # m; the straight drive, negative: backward
    ]
)
"""A path between two poses."""


def find_paths(
    start: Pose,
    goal: Pose,
    entries: Ends,
    exits: Ends,
    limits: Limits,
    *,
    forward: bool = False,
    longest: float = math.inf,
    most: int = 10_000,
) -> Records:
    """Find the `most` fastest paths of up to `longest` s between two poses, with these candidates.

    Returns an array of `PATH`, fastest first. With `forward`, paths whose drive is too short for
    its change of speed are left out, and some others on which the robot drives backward in a turn.
    """
    end = Pose(*map(float, start.relative(goal)))
    return ranked(_search(end, entries, exits, rates_of(limits), forward, float(longest)), most)


def ranked(found: Records, most: int) -> Records:
    """Return the `most` records, or fewer, whose time is least, in ascending order."""
    if len(found) > most:
        found = found[np.argpartition(found["time"], most - 1)[:most]]
    return found[np.argsort(found["time"], kind="stable")]


@compiled
def _search(
    end: Pose,
    entries: Ends,
    exits: Ends,
    rates: Rates,
    forward: bool,
    longest: float,
) -> Records:
    """Return all paths, of `PATH`, to a goal at `end` as seen from the start."""
    found = np.empty(1024, dtype=PATH)
    count = 0
    steps = np.empty(_POINTS, dtype=np.intp)
    near = np.empty((len(entries.times), _POINTS), dtype=np.float32)
    far = np.empty((len(exits.times), _POINTS), dtype=np.float32)
    # Local names avoid reference counting at each access.
    sides1 = entries.sides
    sides2 = exits.sides
    times1 = entries.times
    times2 = exits.times
    along1, across1 = entries.turns
    along2, across2 = exits.turns
    end_cos = math.cos(end.yaw)
    end_sin = math.sin(end.yaw)
    _write_parts(near, entries, 0.0, end.x, end.y)
    for around in range(-1, 2):
        # The whole change of heading may be in either direction, or a full turn more.
        total = end.yaw + around * math.tau
        _write_parts(far, exits, total, 0.0, 0.0)
        for entry in range(len(sides1)):
            side1 = sides1[entry]
            for exit_ in range(len(sides2)):
                side2 = sides2[exit_]
                straight = times1[entry] + times2[exit_]
                fastest = turn_time(abs(total), max(side1.rate, side2.rate), rates.aw)
                if straight + fastest > longest:
                    continue
                back = side2.length
                x = end.x - side1.length - back * end_cos
                offset = Offset(x, end.y - back * end_sin, 0.0)
                for root in range(_write_steps(steps, near, far, entry, exit_, not forward)):
                    at = steps[root]
                    low = _GRID[at]
                    gap = near[entry, at] + far[exit_, at]
                    next_gap = near[entry, at + 1] + far[exit_, at + 1]
                    first = low + _GRID_STEP * (gap / (gap - next_gap))
                    if not abs(total - first) < WIDEST:  # or it is NaN
                        continue
                    # A secant step from there, whose cosine and sine are the first terms of series.
                    cos = math.cos(first)
                    sin = math.sin(first)
                    now = cos * offset.y - sin * offset.x
                    now -= look_up(across1, entry, first) + look_up(across2, exit_, first - total)
                    if now != gap:
                        change = now * (first - low) / (gap - now)
                        change = min(max(change, low - first), low + _GRID_STEP - first)
                        square = change * change
                        by_cos = 1.0 - 0.5 * square
                        by_sin = change * (1.0 - square * (1.0 / 6.0))
                        first += change
                        cos, sin = cos * by_cos - sin * by_sin, sin * by_cos + cos * by_sin
                    last = total - first
                    turn1 = turn_time(abs(first), side1.rate, rates.aw)
                    turn2 = turn_time(abs(last), side2.rate, rates.aw)
                    one = Turn(side1.speed, side1.change, turn1, look_up(along1, entry, first))
                    # as seen from the goal
                    two = Turn(side2.speed, side2.change, turn2, look_up(along2, exit_, -last))
                    drive, before, after = drive_between(one, two, cos, sin, offset, rates)
                    time = straight + drive_time(drive, before, after, rates) + turn1 + turn2
                    if time > longest:
                        continue
                    if forward and drive < change_distance(before, after, rates):
                        continue
                    if count == len(found):
                        found = np.append(found, np.empty_like(found))
                    path = found[count]
                    path.time = time
                    path.entry = entry
                    path.exit = exit_
                    path.first = first
                    path.last = last
                    path.drive = drive
                    count += 1
    return found[:count]


@inlined
def _write_steps(
    steps: NDArray[np.intp],
    near: RealArray,
    far: RealArray,
    entry: int,
    exit_: int,
    both: bool,
) -> int:
    """Write the steps of the grid that contain roots; return their number."""
    count = 0
    for begin in range(0, _POINTS - 1, WIDTH):
        above = np.uint32(0)
        for step in range(WIDTH):
            above |= sign_bit(near[entry, begin + step] + far[exit_, begin + step], step)
        beyond = near[entry, begin + WIDTH] + far[exit_, begin + WIDTH] > np.float32(0.0)
        roots = crossings(int(above) | (int(beyond) << WIDTH), WIDTH, both)
        while roots:
            steps[count] = begin + lowest(roots)
            roots &= roots - 1
            count += 1
    return count


@compiled
def _write_parts(parts: RealArray, ends: Ends, total: float, x: float, y: float) -> None:
    """Write the candidates' parts in the gaps in m, shape (n, _POINTS); NaN if a turn is too wide.

    The turns go from `total` (rad) to each heading of the grid, displaced by (x, y) in m.
    """
    sides = ends.sides
    across = ends.turns.across
    for step in range(_POINTS):
        angle = _GRID[step] - total
        if not abs(angle) < WIDEST:
            parts[:, step] = np.nan
            continue
        cos = math.cos(angle)
        sin = math.sin(angle)
        for end in range(len(parts)):
            ahead = x - sides[end].length
            parts[end, step] = cos * y - sin * ahead - look_up(across, end, angle)
