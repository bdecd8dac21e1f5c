"""The fastest of a set of turn-drive-turn paths, for many pairs of ends: a feature of models.

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
from ator_ros.geometry import FloatArray, Record, Records, record_type

SPEED_STEP = 0.02  # m/s
_TURNS: FloatArray = STEP * np.arange(-HALF, WIDTH - HALF, dtype=float)
_COS = np.cos(_TURNS)
_SIN = np.sin(_TURNS)
_COS32 = np.cos(_TURNS.astype(np.float32))
_SIN32 = np.sin(_TURNS.astype(np.float32))
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
    rates: Rates,
    profiles: tuple[tuple[float, float], ...],
    *,
    forward: bool,
) -> TurnTables:
    """Compute tables for changes of speed (m/s^2) and turn rates (rad/s): 3 MB per m/s and pair."""
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


_SHAPE = record_type(
    [*((name, float) for name in Shape._fields), ("first_row", np.intp), ("last_row", np.intp)]
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
    rows: Records  # the first shapes of all groups, then the others group by group
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
    missed = (2.0 * float(turn_time(turned, rules.rates.w, rules.rates.aw)), 2.0 * turned)
    return ShapeSet(
        rules,
        np.array(rows, dtype=_SHAPE),
        np.cumsum(sizes, dtype=np.intp),
        tables,
        missed,
    )


# A block of pairs of ends is searched shape by shape, in loops over its pairs, slots and roots.

_BLOCK = 64  # pairs; what is known of them fits into the fastest cache
_AROUND = (0.0, -1.0, 1.0)
"""Full turns more: a change of heading may be in either direction, or further."""
_SLOTS = len(_AROUND) * _BLOCK
"""A slot: one of three whole changes of heading of a pair."""
# columns a multiple of 4 KB apart would compete for places in the cache
_ROOTS = WIDTH // 2 * _SLOTS + 8


_PAIR = record_type(
    [
        ("number", np.intp),  # place in the block
        ("group", np.intp),  # of the fastest path so far
        ("time", float),  # s; of that path
        ("turned", float),  # rad; sum of its turns
        ("x", float),  # m; destination
        ("y", float),
        ("object_x", float),  # m; of the object at the destination
        ("object_y", float),
        ("goal_cos", float),  # of the heading there
        ("goal_sin", float),
        ("start", float),  # m/s; speed
        ("arrival", float),  # m/s; speed
        ("total", float, len(_AROUND)),  # rad; whole changes of heading
        ("least", float, len(_AROUND)),  # s; least times of such turns
        ("window", np.intp, len(_AROUND)),  # places of the far turns in the tables
    ]
)
"""A pair of ends, whatever the shape."""

_LEG = record_type(
    [
        ("straight", float),  # s; time of all straight parts but the drive
        ("lead", float),  # m; length before the first turn
        ("speed1", float),  # m/s; where the first turn begins
        ("speed2", float),  # m/s; where the last turn ends
        ("row1", np.intp),  # of the first turn in the tables
        ("row2", np.intp),  # of the last turn
        ("offset_x", float),  # m; from the first turn's beginning to the last one's end
        ("offset_y", float),
    ]
)
"""How paths of one shape begin and end between a pair of ends."""

_COLUMNS = record_type(
    [
        ("pair", np.intp, _ROOTS),
        ("first", float, _ROOTS),  # rad; turns
        ("last", float, _ROOTS),
        ("beyond", float, _ROOTS),  # rad; the part of the first turn beyond a step
        ("cos", float, _ROOTS),  # of that step
        ("sin", float, _ROOTS),
        ("along1", float, _ROOTS),  # m; displacements by the turns
        ("across1", float, _ROOTS),
        ("along2", float, _ROOTS),
        ("ahead", float, _ROOTS),  # m; the object as seen from the first turn
        ("aside", float, _ROOTS),
        ("speed1", float, _ROOTS),  # as in `_LEG`
        ("speed2", float, _ROOTS),
        ("straight", float, _ROOTS),
        ("offset_x", float, _ROOTS),
        ("offset_y", float, _ROOTS),
        ("time", float, _ROOTS),  # s; of the path
    ]
)
"""All roots of a shape in a block, columns of one record: loops over them are vectorized."""


class _Space(NamedTuple):
    """Memory for the search of a block."""

    legs: Records  # shape (_BLOCK,), of `_LEG`
    roots: Records  # shape (1,), of `_COLUMNS`
    gaps: RealArray  # shape (_SLOTS, WIDTH)
    marks: NDArray[np.intp]  # shape (_SLOTS,); roots of each slot, see `crossings`
    pairs: NDArray[np.intp]  # shape (_SLOTS,); pair of each slot
    arounds: NDArray[np.intp]  # shape (_SLOTS,); its change of heading
    nothing: RealArray  # shape (WIDTH,); offsets of the last turn where there is none


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
        ends,
        hold,
        tuple(rates),
        tuple(settings),
        rows,
        others,
        tuple(turns),
        tuple(rest),
        missed,
    )


@compiled
def _fastest_paths(
    ends: FloatArray,
    hold: float,
    rates: Any,
    settings: Any,
    rows: Records,
    others: NDArray[np.intp],
    turns: Any,
    rest: Any,
    missed: tuple[float, float],
) -> FloatArray:
    rules = Rules(Rates(*rates), *settings)
    tables = TurnTables(TurnTable(*turns), *rest)
    result = np.empty((2, ends.shape[1]))
    pairs = np.empty(_BLOCK, dtype=_PAIR)
    members = np.empty(_BLOCK, dtype=_PAIR)
    space = _Space(
        np.empty(_BLOCK, dtype=_LEG),
        np.empty(1, dtype=_COLUMNS),
        np.empty((_SLOTS, WIDTH), dtype=np.float32),
        np.empty(_SLOTS, dtype=np.intp),
        np.empty(_SLOTS, dtype=np.intp),
        np.empty(_SLOTS, dtype=np.intp),
        np.zeros(WIDTH, dtype=np.float32),
    )
    groups = len(others) - 1
    for begin in range(0, ends.shape[1], _BLOCK):
        count = min(_BLOCK, ends.shape[1] - begin)
        _write_pairs(pairs, ends[:, begin : begin + count], hold, rules)
        for group in range(groups):
            _try(rows[group], group, pairs[:count], hold, space, tables, rules)
        for group in range(groups):
            if others[group] == others[group + 1]:
                continue
            size = _write_members(members, pairs[:count], group)
            for other in range(others[group], others[group + 1] if size else 0):
                _try(rows[other], group, members[:size], hold, space, tables, rules)
            for member in members[:size]:
                pair = pairs[member.number]
                pair.time = member.time
                pair.turned = member.turned
        for at in range(count):
            pair = pairs[at]
            found = (pair.time, pair.turned) if pair.time < np.inf else missed
            result[0, begin + at], result[1, begin + at] = found
    return result


@inlined
def _write_pairs(pairs: Records, ends: FloatArray, hold: float, rules: Rules) -> None:
    """Write what is known of pairs, whatever the shape."""
    for at in range(ends.shape[1]):
        x = ends[0, at]
        y = ends[1, at]
        turn = ends[2, at]
        pair = pairs[at]
        pair.time = np.inf
        pair.group = 0
        pair.number = at
        pair.x = x
        pair.y = y
        pair.goal_cos = math.cos(turn)
        pair.goal_sin = math.sin(turn)
        pair.object_x = x + hold * pair.goal_cos
        pair.object_y = y + hold * pair.goal_sin
        pair.start = ends[3, at]
        pair.arrival = ends[4, at]
        whole = 0.0 if rules.free_heading else turn
        for around in range(len(_AROUND)):
            total = whole + math.copysign(math.tau, whole) * _AROUND[around]
            pair.total[around] = total
            pair.least[around] = turn_time(abs(total), rules.rates.w, rules.rates.aw)
            window = 2 * HALF * FINE + 0.5 - total * (FINE / STEP)
            # 0 if it is NaN
            pair.window[around] = int(min(max(0.0, window), 4.0 * HALF * FINE))


@inlined
def _write_members(members: Records, pairs: Records, group: int) -> int:
    """Copy the pairs whose fastest path so far is of a group, of the first if there is none.

    Count them.
    """
    size = 0
    for at in range(len(pairs)):
        if pairs[at].group == group:
            members[size] = pairs[at]
            size += 1
    return size


@compiled
def _try(
    shape: Record,
    group: int,
    pairs: Records,
    hold: float,
    space: _Space,
    tables: TurnTables,
    rules: Rules,
) -> None:
    """Try a shape for all pairs; where it is the fastest so far, write its path and the group."""
    _write_legs(space.legs, pairs, shape, tables, rules)
    slots = _write_gaps(space, pairs, shape, tables, rules)
    found = _write_roots(space, slots, pairs, tables, rules)
    roots = space.roots[0]
    _write_times(roots, found, shape, hold, rules)
    for root in range(found):
        pair = pairs[roots.pair[root]]
        if roots.time[root] < pair.time:
            pair.time = roots.time[root]
            pair.turned = abs(roots.first[root]) + abs(roots.last[root])
            pair.group = group


@inlined
def _write_legs(
    legs: Records,
    pairs: Records,
    shape: Record,
    tables: TurnTables,
    rules: Rules,
) -> None:
    """Write how the paths begin before the first turn and end after the last one."""
    rates = rules.rates
    run = rules.run
    leads = not math.isnan(shape.entry)
    runs = not math.isnan(shape.share)
    for at in range(len(pairs)):
        pair = pairs[at]
        leg = legs[at]
        start = pair.start
        arrival = pair.arrival
        speed1 = shape.entry if leads else start
        lead_time = change_time(start, speed1, rates)
        # Where the run begins
        speed2 = arrival
        length = 0.0
        square = arrival * arrival
        if runs and math.isnan(run):
            speed2 = shape.share * rates.v
            change = speed2 * speed2 - square
            length = max(change * (0.5 / rates.brake), change * (-0.5 / rates.a))
        elif runs:
            fastest = min(math.sqrt(square + 2.0 * rates.brake * run), rates.v)
            slowest = math.sqrt(max(square - 2.0 * rates.a * run, 0.0))
            speed2 = slowest + shape.share * (fastest - slowest)
            length = run
        gaining, steady, losing, _ = forward_parts(length, speed2, arrival, rates)
        excluded = start < shape.least_start or arrival < shape.least_arrival
        leg.straight = np.inf if excluded else lead_time + (gaining + losing + steady)
        leg.lead = 0.5 * (start + speed1) * lead_time
        leg.speed1 = speed1
        leg.speed2 = speed2
        leg.row1 = _row_of(tables, shape.first_row, speed1)
        leg.row2 = _row_of(tables, shape.last_row, speed2)
        x = pair.object_x if rules.free_heading else pair.x
        y = pair.object_y if rules.free_heading else pair.y
        leg.offset_x = x - leg.lead - length * pair.goal_cos
        leg.offset_y = y - length * pair.goal_sin


@inlined
def _row_of(tables: TurnTables, first: int, speed: float) -> int:
    """Return the row of the turn that starts at `speed` (m/s).

    `first` is the row of the lowest speed.
    """
    row = (speed - tables.lowest) * (1.0 / SPEED_STEP) + 0.5
    return first + int(min(max(0.0, row), tables.speeds - 1.0))  # 0 if the speed is NaN


@inlined
def _write_gaps(
    space: _Space,
    pairs: Records,
    shape: Record,
    tables: TurnTables,
    rules: Rules,
) -> int:
    """Write the lateral errors for each first turn in slots that may have the fastest path.

    Count them.
    """
    slots = 0
    # Local names avoid reference counting at each access.
    legs = space.legs
    all_gaps = space.gaps
    marks = space.marks
    direction = np.float32(shape.direction)
    fractions = tables.fractions
    nothing = space.nothing
    for at in range(len(pairs)):
        pair = pairs[at]
        leg = legs[at]
        if leg.straight >= pair.time:
            continue
        x, y = np.float32(leg.offset_x), np.float32(leg.offset_y)
        near = fractions[leg.row1, 0, 2 * HALF : 2 * HALF + WIDTH]
        for around in range(1 if rules.free_heading else 3 if rules.forward else 2):
            if leg.straight + pair.least[around] > pair.time:
                continue
            if rules.free_heading:
                far = nothing
            else:
                window = pair.window[around]
                column = window // FINE
                far = fractions[leg.row2, window % FINE, column : column + WIDTH]
            gaps = all_gaps[slots]
            above = np.uint32(0)
            for step in range(WIDTH):
                gap = direction * (y * _COS32[step] - x * _SIN32[step] - near[step] - far[step])
                gaps[step] = gap
                above = np.uint32(above | sign_bit(gap, step))
            marks[slots] = crossings(int(above), 2 * HALF, False)
            space.pairs[slots] = at
            space.arounds[slots] = around
            slots += 1
    return slots


@inlined
def _write_roots(
    space: _Space,
    slots: int,
    pairs: Records,
    tables: TurnTables,
    rules: Rules,
) -> int:
    """Write the paths of all roots in the slots, without their times; return how many they are."""
    found = 0
    legs = space.legs
    all_gaps = space.gaps
    marks = space.marks
    along, across = tables.turns
    roots = space.roots[0]
    for slot in range(slots):
        left = marks[slot]
        if left == 0:
            continue
        at = space.pairs[slot]
        pair = pairs[at]
        leg = legs[at]
        gaps = all_gaps[slot]
        total = pair.total[space.arounds[slot]]
        while left:
            step = lowest(left)
            left &= left - 1
            beyond = np.float64(_STEP * (gaps[step] / (gaps[step] - gaps[step + 1])))
            first = _TURNS[step] + beyond
            last = 0.0 if rules.free_heading else total - first
            if not (abs(last) < WIDEST and abs(first) + abs(last) < _MOST_TURNED):
                continue
            roots.pair[found] = at
            roots.first[found] = first
            roots.last[found] = last
            roots.beyond[found] = beyond
            roots.cos[found] = _COS[step]
            roots.sin[found] = _SIN[step]
            roots.along1[found] = look_up(along, leg.row1, first)
            roots.along2[found] = look_up(along, leg.row2, -last)  # driven from the goal
            roots.speed1[found] = leg.speed1
            roots.speed2[found] = leg.speed2
            roots.straight[found] = leg.straight
            roots.offset_x[found] = leg.offset_x
            roots.offset_y[found] = leg.offset_y
            if rules.passing > 0.0:
                roots.across1[found] = look_up(across, leg.row1, first)
                roots.ahead[found] = pair.object_x - leg.lead
                roots.aside[found] = pair.object_y
            found += 1
    return found


_DETOUR = 7.2
"""Cost, in m at full speed, of each m by which a drive is too near to the goal's object."""
_SHORTFALL = 2.0
"""Cost, in m at full speed, of each m that a drive is too short for its change of speed.

Then the robot turns at other speeds."""
# m by which a drive must exceed its change of speed if there is no last turn to compensate
_SPARE = 0.02
_MOST_TURNED = math.radians(450.0)  # sum of both turns


@inlined
def _write_times(roots: Record, count: int, shape: Record, hold: float, rules: Rules) -> None:
    """Write the times in s of paths; they are infinite where a path is not allowed."""
    rates = rules.rates
    free = rules.free_heading
    for root in range(count):
        cos, sin = _cos_sin(roots.cos[root], roots.sin[root], roots.beyond[root])
        time1 = turn_time(abs(roots.first[root]), shape.first_rate, rates.aw)
        time2 = turn_time(abs(roots.last[root]), shape.last_rate, rates.aw)
        one = Turn(roots.speed1[root], shape.first_change, time1, roots.along1[root])
        two = Turn(roots.speed2[root], shape.last_change, time2, roots.along2[root])
        between = Offset(roots.offset_x[root], roots.offset_y[root], hold if free else 0.0)
        length, before, after = drive_between(one, two, cos, sin, between, rates)
        time = time1 + time2 + roots.straight[root]
        allowed = True
        if rules.forward:
            least = change_distance(before, after, rates)
            allowed = length >= (least + _SPARE if free else 0.0)
            time += _SHORTFALL / rates.v * max(least - length, 0.0)
            length = max(length, least)
        time += drive_time(length, before, after, rates)
        if rules.passing > 0.0:
            ahead = roots.ahead[root]
            aside = roots.aside[root]
            to_object = cos * ahead + sin * aside - one.along - one.speed * time1
            beside = cos * aside - sin * ahead - roots.across1[root]
            passes = min(length, 0.0) < to_object < max(length, 0.0)
            time += _DETOUR / rates.v * max(rules.passing - abs(beside), 0.0) if passes else 0.0
        roots.time[root] = time if allowed else np.inf


@inlined
def _cos_sin(cos: float, sin: float, beyond: float) -> tuple[float, float]:
    """Return cosine and sine of an angle, given those for up to `STEP` rad less, by series."""
    x = beyond * beyond
    cos4 = 1 / 24 - x * (1 / 720 - x * (1 / 40320 - x * (1 / 3628800)))
    near_cos = 1.0 - x * (1 / 2 - x * cos4)
    sin5 = 1 / 120 - x * (1 / 5040 - x * (1 / 362880))
    near_sin = beyond * (1.0 - x * (1 / 6 - x * sin5))
    return cos * near_cos - sin * near_sin, sin * near_cos + cos * near_sin


_GROUPS = 16
"""Greatest number of groups; the time of a search grows with it."""
_OTHERS = 24
"""Greatest number of other shapes in each group; the time of a search grows with it."""
# choosing ends when times exceed those of the whole grid by less than this share on average
_NEAR = 0.0005
_LATE = 3.0  # multiple of the least time where no chosen shape reaches the destination


def needed_shapes(grid: ShapeSet, ends: FloatArray, *, hold: float) -> list[list[int]]:
    """Return groups of those shapes of a grid, by index, that are needed between ends.

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
    """Return random ends, shape (5, count), with distances and speeds as in `like`, shape (5, n).

    Directions are uniform. Half of the distances are scaled down at random. The same share as in
    `like` begins, and ends, at rest; other speeds are uniform in its range.
    """
    some = like[:, rng.integers(0, like.shape[1], count)]
    distance = np.hypot(some[0], some[1]) * np.where(
        rng.random(count) < 0.5,
        rng.random(count),
        1.0,
    )
    bearing, turn = rng.uniform(-np.pi, np.pi, (2, count))
    moving = rng.random((2, count)) < (like[3:] != 0.0).mean(axis=1)[:, None]
    least = like[3:].min(axis=1)[:, None]
    greatest = like[3:].max(axis=1)[:, None]
    speeds = moving * rng.uniform(least, greatest, (2, count))
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), turn, *speeds))
