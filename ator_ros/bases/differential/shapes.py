"""The fastest of a set of turn-drive-turn paths, for many pairs of ends at once: a feature of the models.

A shape of path is a turn, a straight drive, a turn and a straight run, with given changes of speed.
Shapes come in groups: the first of each group is tried for all ends, then the others of the group
whose first one is the fastest (of the first group, where none leads there). `needed_shapes` chooses
groups from a fine grid.

The search is compiled, since it dominates refinement. Unlike the search for all paths it
interpolates roots linearly on a coarse grid, and does not refine them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.bases.differential.durations import (
    Rates,
    change_distance,
    change_time,
    drive_time,
    forward_parts,
    turn_time,
)
from ator_ros.bases.differential.paths import (
    WIDTH,
    Offset,
    RealArray,
    Turn,
    crossings,
    drive_between,
    lowest,
    sign_bit,
)
from ator_ros.bases.differential.turns import (
    ENTRIES,
    FINE,
    HALF,
    STEP,
    WIDEST,
    TurnTable,
    look_up,
    turn_table,
)
from ator_ros.compiled import compiled, inlined
from ator_ros.geometry import FloatArray

Rows = NDArray[np.void]

SPEED_STEP = 0.02  # m/s
_TURNS: FloatArray = STEP * np.arange(-HALF, WIDTH - HALF, dtype=float)
_COS, _SIN = np.cos(_TURNS), np.sin(_TURNS)
_COS32, _SIN32 = np.cos(_TURNS.astype(np.float32)), np.sin(_TURNS.astype(np.float32))
_STEP = np.float32(STEP)


class TurnTables(NamedTuple):
    """Turns for each profile (change of speed, greatest turn rate) and each speed up to the limit.

    `fractions`, shape (rows, FINE, columns), is `turns.across`, rearranged so that turns one step
    apart are contiguous.
    """

    turns: TurnTable  # a row for each profile and speed
    fractions: RealArray
    lowest: float  # m/s; first speed, 0 where the robot never drives backward
    speeds: int  # number of speeds


@lru_cache(maxsize=6)
def turn_tables(
    rates: Rates, profiles: tuple[tuple[float, float], ...], *, forward: bool
) -> TurnTables:
    """Compute tables for changes of speed (m/s^2) and turn rates (rad/s): 3 MB for each m/s and profile."""
    speeds = np.arange(-rates.v, rates.v + SPEED_STEP / 2, SPEED_STEP)
    speeds = speeds[speeds > -SPEED_STEP] if forward else speeds
    rows = [(speed, *profile) for profile in profiles for speed in speeds.tolist()]
    turns = turn_table(np.array(rows), rates)
    # Turns are moved by up to 2 * HALF steps to either side; values outside the table are discarded
    # later.
    beyond = (2 * HALF - 1) * FINE
    across = turns.across.reshape(-1, ENTRIES)
    wide = np.pad(across[:, :-1], ((0, 0), (beyond, beyond + 2 * FINE)), mode="edge").astype(
        np.float32
    )
    filled = ((0, 0), (0, WIDTH - 2 * HALF - 1))
    fractions = np.pad(wide.reshape(len(wide), -1, FINE).swapaxes(1, 2), ((0, 0), *filled))
    return TurnTables(turns, fractions, float(speeds[0]), len(speeds))


class Shape(NamedTuple):
    """One shape of path: turn, drive straight, turn, run straight to the goal.

    `share` gives the speed between last turn and run. For a run of a given length it goes from the
    least (0) to the greatest (1) speed from which the run can reach its end speed; for a run as
    long as needed it is a share of the limit. NaN: there is no run.
    """

    first_change: float  # m/s^2; change of speed in the first turn, up to the limit
    first_rate: float  # rad/s; its greatest turn rate
    last_change: float  # those of the last turn as seen from the goal, backward in time
    last_rate: float
    share: float = 0.0
    # m/s; reached on a straight line before the first turn, NaN: there is none
    entry: float = np.nan
    least_start: float = np.nan  # m/s; least speed at the start, NaN: any
    least_arrival: float = np.nan  # m/s; least speed at the goal, NaN: any
    direction: float = 1.0  # of the drive between the turns: 1 forward, -1 backward


_SHAPE = np.dtype(
    [(name, np.float32 if name == "direction" else float) for name in Shape._fields]
    + [("first_row", np.intp), ("last_row", np.intp)],
    align=True,
)
"""A shape of path, and the first rows of its turns in the tables."""


class Rules(NamedTuple):
    """The settings that all shapes of a set share.

    If `free_heading`, any heading at the destination will do: there is no last turn, and the drive
    ends when the object in front of the robot is there.
    """

    rates: Rates
    run: float = 0.0  # m; straight run at the end, NaN: as long as its change of speed needs
    passing: float = 0.0  # m; distance between the drive and an object at the goal, 0: no object
    forward: bool = False  # the robot never drives backward
    free_heading: bool = False


class ShapeSet(NamedTuple):
    """Shapes of paths, of which the fastest counts."""

    rules: Rules
    rows: Rows  # the first shapes of all groups, then the others group by group
    # shape (groups + 1,); first row of the others of each group, and the end
    others: NDArray[np.intp]
    tables: TurnTables
    # time (s) and angle (rad) of ends between which no tried shape leads
    missed: tuple[float, float]


def shape_set(groups: Sequence[Sequence[Shape]], rules: Rules) -> ShapeSet:
    """Return a set of shapes in groups: the others are tried where the first one is the fastest."""
    shapes = [group[0] for group in groups]
    shapes += itertools.chain.from_iterable(group[1:] for group in groups)
    profiles = tuple(
        dict.fromkeys(profile for shape in shapes for profile in (shape[:2], shape[2:4]))
    )
    tables = turn_tables(rules.rates, profiles, forward=rules.forward)
    first_row = {profile: number * tables.speeds for number, profile in enumerate(profiles)}
    rows = [(*shape, first_row[shape[:2]], first_row[shape[2:4]]) for shape in shapes]
    sizes = [len(groups), *(len(group) - 1 for group in groups)]
    turned = 2.0 * math.pi if rules.forward else math.pi
    missed = 2.0 * float(turn_time(turned, rules.rates.w, rules.rates.aw)), 2.0 * turned
    return ShapeSet(
        rules, np.array(rows, dtype=_SHAPE), np.cumsum(sizes, dtype=np.intp), tables, missed
    )


# A block of pairs of ends is searched shape by shape. One array holds all numbers of its pairs,
# column by column, another one those of roots: the compiler vectorizes loops over columns at
# distances that it knows.

_PAIRS = 64  # of a block; what is known of them fits into the fastest cache
_SLOTS = 3 * _PAIRS  # a slot: one of three whole changes of heading of a pair
# columns a multiple of 4 KB apart would compete for places in the cache
_ROOTS = WIDTH // 2 * _SLOTS + 8
# full turns more: a change of heading may be in either direction, or further
_AROUND = (0.0, -1.0, 1.0)

# Columns of pairs. The fastest path so far: its time, angles turned, group; the pair's number in
# the block,
_TIME, _TURNED, _GROUP, _NUMBER = (column * _PAIRS for column in range(4))
# destination, also of the object there, direction of the goal, speeds at both ends,
_X, _Y, _OBJECT_X, _OBJECT_Y, _GOAL_COS, _GOAL_SIN, _START, _ARRIVAL = (
    n * _PAIRS for n in range(4, 12)
)
# for each slot its whole change of heading, the least time of such a turn, and the place of its far
# turns;
_TOTAL, _LEAST, _WINDOW = (column * _PAIRS for column in (12, 15, 18))
_GIVEN = 21  # columns so far; the others are written for each shape:
# length before the first turn, speeds and rows of both turns, time of straight parts, offset
# between turns.
_LEAD, _SPEED1, _ROW1, _SPEED2, _ROW2, _STRAIGHT, _OFFSET_X, _OFFSET_Y = (
    n * _PAIRS for n in range(21, 29)
)
# Columns of roots: pair, first turn, its part beyond a step and cosine and sine of that step, last
# turn,
_PAIR, _FIRST, _BEYOND, _COS_STEP, _SIN_STEP, _LAST = (column * _ROOTS for column in range(6))
# displacements by both turns, the object as seen from the first one, the time of the path,
_ALONG1, _ACROSS1, _ALONG2, _AHEAD, _ASIDE, _ROOT_TIME = (
    column * _ROOTS for column in range(6, 12)
)
# and numbers of the pair, side by side for vectors: speeds, time of straight parts, offset between
# turns
_ROOT_SPEED1, _ROOT_SPEED2, _ROOT_STRAIGHT, _ROOT_X, _ROOT_Y = (n * _ROOTS for n in range(12, 17))
_PAIR_COLUMNS, _ROOT_COLUMNS = 29, 17


class _Space(NamedTuple):
    """Memory for the search of a block."""

    roots: FloatArray
    gaps: RealArray  # shape (_SLOTS * WIDTH,)
    marks: NDArray[np.intp]  # shape (_SLOTS,); roots of each slot, see `crossings`
    # number of the pair, and _PAIRS more for each further change of heading
    places: NDArray[np.intp]
    nothing: RealArray  # offsets of the last turn where there is none


def fastest_paths(ends: FloatArray, shapes: ShapeSet, hold: float) -> FloatArray:
    """Return the fastest path of these shapes for each of n pairs of ends.

    Parameters
    ----------
    ends : ndarray, shape (5, n)
        Both ends, in the frame of the start: destination x, y of the axle in m and heading there in
        rad, forward speeds at the start and at the destination in m/s.
    hold : float
        Distance in m from the destination to the object in front of it.

    Returns
    -------
    ndarray, shape (2, n)
        Their times in s, and the sums of the angles of both turns in rad.
    """
    (rates, *settings), rows, others, (turns, *rest), missed = shapes
    # Passing named tuples would take longer than the search for a pair.
    return _fastest_paths(
        ends, hold, tuple(rates), tuple(settings), rows, others, tuple(turns), tuple(rest), missed
    )


@compiled
def _fastest_paths(
    ends: FloatArray,
    hold: float,
    rates: Any,
    settings: Any,
    rows: Rows,
    others: NDArray[np.intp],
    turns: Any,
    rest: Any,
    missed: tuple[float, float],
) -> FloatArray:
    rules, tables = Rules(Rates(*rates), *settings), TurnTables(TurnTable(*turns), *rest)
    result = np.empty((2, ends.shape[1]))
    pairs, members = np.empty(_PAIR_COLUMNS * _PAIRS), np.empty(_PAIR_COLUMNS * _PAIRS)
    space = _Space(
        np.empty(_ROOT_COLUMNS * _ROOTS),
        np.empty(_SLOTS * WIDTH, dtype=np.float32),
        np.empty(_SLOTS, dtype=np.intp),
        np.empty(_SLOTS, dtype=np.intp),
        np.zeros(WIDTH, dtype=np.float32),
    )
    groups = len(others) - 1
    for begin in range(0, ends.shape[1], _PAIRS):
        count = min(_PAIRS, ends.shape[1] - begin)
        _write_pairs(pairs, ends[:, begin : begin + count], hold, rules)
        for group in range(groups):
            _try(rows[group], group, pairs, count, hold, space, tables, rules)
        for group in range(groups):
            if others[group] == others[group + 1]:
                continue
            size = _write_members(members, pairs, count, group)
            for other in range(others[group], others[group + 1] if size else 0):
                _try(rows[other], group, members, size, hold, space, tables, rules)
            for at in range(size):
                number = int(members[_NUMBER + at])
                pairs[_TIME + number], pairs[_TURNED + number] = (
                    members[_TIME + at],
                    members[_TURNED + at],
                )
        for at in range(count):
            reached = pairs[_TIME + at] < np.inf
            found = (pairs[_TIME + at], pairs[_TURNED + at]) if reached else missed
            result[0, begin + at], result[1, begin + at] = found
    return result


@inlined
def _write_pairs(pairs: FloatArray, ends: FloatArray, hold: float, rules: Rules) -> None:
    """Write the columns of pairs that hold for all shapes."""
    for at in range(ends.shape[1]):
        x, y, turn = ends[0, at], ends[1, at], ends[2, at]
        cos, sin = math.cos(turn), math.sin(turn)
        pairs[_TIME + at], pairs[_GROUP + at], pairs[_NUMBER + at] = np.inf, 0.0, at
        pairs[_X + at], pairs[_Y + at] = x, y
        pairs[_OBJECT_X + at], pairs[_OBJECT_Y + at] = x + hold * cos, y + hold * sin
        pairs[_GOAL_COS + at], pairs[_GOAL_SIN + at] = cos, sin
        pairs[_START + at], pairs[_ARRIVAL + at] = ends[3, at], ends[4, at]
        whole = 0.0 if rules.free_heading else turn
        for around in range(3):
            place, total = (
                around * _PAIRS + at,
                whole + math.copysign(math.tau, whole) * _AROUND[around],
            )
            pairs[_TOTAL + place] = total
            pairs[_LEAST + place] = turn_time(abs(total), rules.rates.w, rules.rates.aw)
            window = 2 * HALF * FINE + 0.5 - total * (FINE / STEP)
            # 0 if it is NaN
            pairs[_WINDOW + place] = np.floor(min(max(0.0, window), 4.0 * HALF * FINE))


@inlined
def _write_members(members: FloatArray, pairs: FloatArray, count: int, group: int) -> int:
    """Copy the pairs whose fastest path so far is of a group, of the first if there is none.

    Count them.
    """
    size = 0
    for at in range(count):
        if pairs[_GROUP + at] == group:
            for column in range(_GIVEN):
                members[column * _PAIRS + size] = pairs[column * _PAIRS + at]
            size += 1
    return size


@compiled
def _try(
    shape: np.void,
    group: int,
    pairs: FloatArray,
    count: int,
    hold: float,
    space: _Space,
    tables: TurnTables,
    rules: Rules,
) -> None:
    """Try a shape for all pairs; where it is the fastest so far, write its path and the group."""
    _write_ends(pairs, count, shape, tables, rules)
    slots = _write_gaps(space, pairs, count, shape, tables, rules)
    roots, found = space.roots, _write_roots(space, slots, pairs, tables, rules)
    _write_times(roots, found, shape, hold, rules)
    for root in range(found):
        at = int(roots[_PAIR + root])
        if roots[_ROOT_TIME + root] < pairs[_TIME + at]:
            pairs[_TIME + at], pairs[_GROUP + at] = roots[_ROOT_TIME + root], group
            pairs[_TURNED + at] = abs(roots[_FIRST + root]) + abs(roots[_LAST + root])


@inlined
def _write_ends(
    pairs: FloatArray, count: int, shape: np.void, tables: TurnTables, rules: Rules
) -> None:
    """Write how the paths begin before the first turn and end after the last one."""
    rates, run = rules.rates, rules.run
    leads, runs = not math.isnan(shape["entry"]), not math.isnan(shape["share"])
    x, y = (_OBJECT_X, _OBJECT_Y) if rules.free_heading else (_X, _Y)
    for at in range(count):
        start, arrival = pairs[_START + at], pairs[_ARRIVAL + at]
        speed1 = shape["entry"] if leads else start
        lead_time = change_time(start, speed1, rates)
        lead = 0.5 * (start + speed1) * lead_time
        # Where the run begins
        speed2, length, square = arrival, 0.0, arrival * arrival
        if runs and math.isnan(run):
            speed2 = shape["share"] * rates.v
            change = speed2 * speed2 - square
            length = max(change * (0.5 / rates.brake), change * (-0.5 / rates.a))
        elif runs:
            fastest = min(math.sqrt(square + 2.0 * rates.brake * run), rates.v)
            slowest = math.sqrt(max(square - 2.0 * rates.a * run, 0.0))
            speed2, length = slowest + shape["share"] * (fastest - slowest), run
        gaining, steady, losing, _ = forward_parts(length, speed2, arrival, rates)
        excluded = start < shape["least_start"] or arrival < shape["least_arrival"]
        pairs[_STRAIGHT + at] = np.inf if excluded else lead_time + (gaining + losing + steady)
        pairs[_LEAD + at], pairs[_SPEED1 + at], pairs[_SPEED2 + at] = lead, speed1, speed2
        pairs[_ROW1 + at] = _row_of(tables, shape["first_row"], speed1)
        pairs[_ROW2 + at] = _row_of(tables, shape["last_row"], speed2)
        pairs[_OFFSET_X + at] = pairs[x + at] - lead - length * pairs[_GOAL_COS + at]
        pairs[_OFFSET_Y + at] = pairs[y + at] - length * pairs[_GOAL_SIN + at]


@inlined
def _row_of(tables: TurnTables, first: int, speed: float) -> float:
    """Return the row of the turn that starts at `speed` (m/s).

    `first` is the row of the lowest speed.
    """
    row: float = np.floor((speed - tables.lowest) * (1.0 / SPEED_STEP) + 0.5)
    return first + min(max(0.0, row), tables.speeds - 1.0)  # 0 if the speed is NaN


@inlined
def _write_gaps(
    space: _Space, pairs: FloatArray, count: int, shape: np.void, tables: TurnTables, rules: Rules
) -> int:
    """Write the lateral errors for each first turn in slots that may have the fastest path.

    Count them.
    """
    # Local names avoid reference counting at each access.
    slots, direction, fractions = 0, shape["direction"], tables.fractions
    all_gaps, marks, places, nothing = space.gaps, space.marks, space.places, space.nothing
    for at in range(count):
        straight, best = pairs[_STRAIGHT + at], pairs[_TIME + at]
        if straight >= best:
            continue
        x, y = np.float32(pairs[_OFFSET_X + at]), np.float32(pairs[_OFFSET_Y + at])
        near = fractions[int(pairs[_ROW1 + at]), 0, 2 * HALF : 2 * HALF + WIDTH]
        for around in range(1 if rules.free_heading else 3 if rules.forward else 2):
            place = around * _PAIRS + at
            if straight + pairs[_LEAST + place] > best:
                continue
            if rules.free_heading:
                far = nothing
            else:
                window = int(pairs[_WINDOW + place])
                column = window // FINE
                far = fractions[int(pairs[_ROW2 + at]), window % FINE, column : column + WIDTH]
            gaps, above = all_gaps[slots * WIDTH : (slots + 1) * WIDTH], np.uint32(0)
            for step in range(WIDTH):
                gap = direction * (y * _COS32[step] - x * _SIN32[step] - near[step] - far[step])
                gaps[step] = gap
                above = np.uint32(above | sign_bit(gap, step))
            marks[slots], places[slots] = crossings(int(above), 2 * HALF, False), place
            slots += 1
    return slots


@inlined
def _write_roots(
    space: _Space, slots: int, pairs: FloatArray, tables: TurnTables, rules: Rules
) -> int:
    """Write the paths of all roots in the slots, without their times; return how many they are."""
    roots, all_gaps, marks, places, _ = space
    (along, across), found = tables.turns, 0
    for slot in range(slots):
        left = marks[slot]
        if left == 0:
            continue
        total, at = pairs[_TOTAL + places[slot]], places[slot] % _PAIRS
        gaps = all_gaps[slot * WIDTH : (slot + 1) * WIDTH]
        row1, row2 = int(pairs[_ROW1 + at]), int(pairs[_ROW2 + at])
        speed1, speed2, straight = pairs[_SPEED1 + at], pairs[_SPEED2 + at], pairs[_STRAIGHT + at]
        x, y = pairs[_OFFSET_X + at], pairs[_OFFSET_Y + at]
        ahead, aside = pairs[_OBJECT_X + at] - pairs[_LEAD + at], pairs[_OBJECT_Y + at]
        while left:
            step = lowest(left)
            left &= left - 1
            beyond = np.float64(_STEP * (gaps[step] / (gaps[step] - gaps[step + 1])))
            first = _TURNS[step] + beyond
            last = 0.0 if rules.free_heading else total - first
            if not (abs(last) < WIDEST and abs(first) + abs(last) < _MOST_TURNED):
                continue
            roots[_PAIR + found], roots[_FIRST + found], roots[_LAST + found] = at, first, last
            roots[_BEYOND + found] = beyond
            roots[_COS_STEP + found], roots[_SIN_STEP + found] = _COS[step], _SIN[step]
            roots[_ALONG1 + found] = look_up(along, row1, first)
            roots[_ALONG2 + found] = look_up(along, row2, -last)  # driven from the goal
            roots[_ROOT_SPEED1 + found], roots[_ROOT_SPEED2 + found] = speed1, speed2
            roots[_ROOT_STRAIGHT + found] = straight
            roots[_ROOT_X + found], roots[_ROOT_Y + found] = x, y
            if rules.passing > 0.0:
                roots[_ACROSS1 + found] = look_up(across, row1, first)
                roots[_AHEAD + found], roots[_ASIDE + found] = ahead, aside
            found += 1
    return found


_DETOUR, _SHORTFALL = 7.2, 2.0
"""Costs, in m of driving at full speed, of each m by which a drive is too near to an object at the goal, and
of each m that a drive forward is too short for its change of speed: then the robot turns at other speeds."""
# m by which a drive must exceed its change of speed if there is no last turn to compensate
_SPARE = 0.02
_MOST_TURNED = math.radians(450.0)  # sum of both turns


@inlined
def _write_times(roots: FloatArray, count: int, shape: np.void, hold: float, rules: Rules) -> None:
    """Write the times in s of paths; they are infinite where a path is not allowed."""
    rates, free = rules.rates, rules.free_heading
    for root in range(count):
        cos, sin = _cos_sin(roots[_COS_STEP + root], roots[_SIN_STEP + root], roots[_BEYOND + root])
        time1 = turn_time(abs(roots[_FIRST + root]), shape["first_rate"], rates.aw)
        time2 = turn_time(abs(roots[_LAST + root]), shape["last_rate"], rates.aw)
        one = Turn(roots[_ROOT_SPEED1 + root], shape["first_change"], time1, roots[_ALONG1 + root])
        two = Turn(roots[_ROOT_SPEED2 + root], shape["last_change"], time2, roots[_ALONG2 + root])
        between = Offset(roots[_ROOT_X + root], roots[_ROOT_Y + root], hold if free else 0.0)
        length, before, after = drive_between(one, two, cos, sin, between, rates)
        time, allowed = time1 + time2 + roots[_ROOT_STRAIGHT + root], True
        if rules.forward:
            least = change_distance(before, after, rates)
            allowed = length >= (least + _SPARE if free else 0.0)
            time += _SHORTFALL / rates.v * max(least - length, 0.0)
            length = max(length, least)
        time += drive_time(length, before, after, rates)
        if rules.passing > 0.0:
            ahead, aside = roots[_AHEAD + root], roots[_ASIDE + root]
            to_object = cos * ahead + sin * aside - one.along - one.speed * time1
            beside = cos * aside - sin * ahead - roots[_ACROSS1 + root]
            passes = min(length, 0.0) < to_object < max(length, 0.0)
            time += _DETOUR / rates.v * max(rules.passing - abs(beside), 0.0) if passes else 0.0
        roots[_ROOT_TIME + root] = time if allowed else np.inf


@inlined
def _cos_sin(cos: float, sin: float, beyond: float) -> tuple[float, float]:
    """Return cosine and sine of an angle, given those for 0 to `STEP` rad less, to 1e-12, by series."""
    x = beyond * beyond
    near_cos = 1.0 - x * (
        1 / 2 - x * (1 / 24 - x * (1 / 720 - x * (1 / 40320 - x * (1 / 3628800))))
    )
    near_sin = beyond * (1.0 - x * (1 / 6 - x * (1 / 120 - x * (1 / 5040 - x * (1 / 362880)))))
    return cos * near_cos - sin * near_sin, sin * near_cos + cos * near_sin


_GROUPS, _OTHERS = 16, 24
"""Greatest numbers of groups, and of other shapes in each; the time of a search grows with both."""
# choosing ends when times exceed those of the whole grid by less than this share on average
_NEAR = 0.0005
_LATE = 3.0  # multiple of the least time where no chosen shape reaches the destination


def needed_shapes(grid: ShapeSet, ends: FloatArray, *, hold: float) -> list[list[int]]:
    """Return groups of the shapes, by index in a grid of groups of one, that are needed between ends.

    The next shape is the one that reduces the times most. It takes a second for a grid of a
    thousand shapes; for `ends`, shape (5, n), and `hold` see `fastest_paths`.
    """
    alone = grid._replace(others=np.ones(2, dtype=np.intp), missed=(np.inf, 0.0))
    each = (alone._replace(rows=grid.rows[number : number + 1]) for number in range(len(grid.rows)))
    times = np.stack([fastest_paths(ends, shape, hold)[0] for shape in each])
    least = times.min(axis=0)
    reached = np.isfinite(least)
    if not reached.any():
        return [[0]]
    ratios = np.minimum(times[:, reached] / least[reached], _LATE)
    firsts = _chosen(ratios, np.full(ratios.shape[1], _LATE), _GROUPS)
    nearest = ratios[firsts].argmin(axis=0)
    groups = [(first, ratios[:, nearest == number]) for number, first in enumerate(firsts)]
    return [[first, *_chosen(where, where[first], _OTHERS)] for first, where in groups]


def _chosen(ratios: FloatArray, so_far: FloatArray, most: int) -> list[int]:
    """Choose shapes by the ratios of their times to the least, shape (shapes, n), greedily."""
    chosen: list[int] = []
    while len(chosen) < most and so_far.sum() > (1.0 + _NEAR) * len(so_far):
        chosen.append(int(np.argmin(np.minimum(so_far, ratios).sum(axis=1))))
        so_far = np.minimum(so_far, ratios[chosen[-1]])
    return chosen


def drawn_ends(like: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Return random ends of paths, shape (5, count), with distances and speeds as in `like`, shape (5, n).

    Directions are uniform. Half of the distances are scaled down at random. The same share as in
    `like` begins, and ends, at rest; other speeds are uniform in its range.
    """
    some = like[:, rng.integers(0, like.shape[1], count)]
    distance = np.hypot(some[0], some[1]) * np.where(
        rng.random(count) < 0.5, rng.random(count), 1.0
    )
    bearing, turn = rng.uniform(-np.pi, np.pi, (2, count))
    moving = rng.random((2, count)) < (like[3:] != 0.0).mean(axis=1)[:, None]
    least, greatest = like[3:].min(axis=1)[:, None], like[3:].max(axis=1)[:, None]
    speeds = moving * rng.uniform(least, greatest, (2, count))
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), turn, *speeds))
