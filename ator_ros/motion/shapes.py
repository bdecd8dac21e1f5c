"""The fastest of a set of turn-drive-turn paths, for many pairs of ends at once: a feature of the models.

A shape of path is a turn, a straight drive, a turn and a straight run, with given changes of speed. Shapes
come in groups: the first of each group is tried for all ends, the others of a group where its first one is
the fastest. `needed_shapes` chooses groups from a fine grid.

The search is compiled, since it dominates refinement. Unlike the search for all paths it interpolates roots
linearly on a coarse grid, and does not refine them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled, inlined
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import (
    Rates,
    change_distance,
    change_time,
    drive_time,
    forward_parts,
    turn_time,
)
from ator_ros.motion.paths import WIDTH, Offset, RealArray, Turn, crossings, drive_between, lowest, sign_bit
from ator_ros.motion.turns import ENTRIES, FINE, HALF, STEP, WIDEST, TurnTable, look_up, turn_table

Rows = NDArray[np.void]

SPEED_STEP = 0.02  # m/s
_TURNS: FloatArray = STEP * np.arange(-HALF, WIDTH - HALF, dtype=float)
_COS, _SIN = np.cos(_TURNS), np.sin(_TURNS)
_COS32, _SIN32 = np.cos(_TURNS.astype(np.float32)), np.sin(_TURNS.astype(np.float32))
_STEP = np.float32(STEP)


class TurnTables(NamedTuple):
    """Turns for each profile (change of speed, greatest turn rate) and each speed up to the limit.

    `fractions`, shape (rows, FINE, columns), is `turns.across`, rearranged so that turns one step apart are
    contiguous; see `_window_of`.
    """

    turns: TurnTable  # a row for each profile and speed
    fractions: RealArray
    lowest: float  # m/s; first speed, 0 where the robot never drives backward
    speeds: int  # number of speeds


@compiled
def _row_of(tables: TurnTables, first: int, speed: float) -> int:
    """Return the row of the turn that starts at `speed` (m/s); `first` is the row of the lowest speed."""
    row = int((speed - tables.lowest) * (1.0 / SPEED_STEP) + 0.5)
    return first + min(max(row, 0), tables.speeds - 1)


@compiled
def _window_of(moved: float) -> tuple[int, int]:
    """Return the indices in a row of `fractions` of the first turn plus `moved` (rad, within 540 degrees)."""
    place = int(2 * HALF * FINE + 0.5 + moved * (FINE / STEP))
    return place % FINE, place // FINE


@lru_cache(maxsize=6)
def turn_tables(rates: Rates, profiles: tuple[tuple[float, float], ...], *, forward: bool) -> TurnTables:
    """Compute tables for changes of speed (m/s^2) and turn rates (rad/s): 3 MB for each m/s and profile."""
    speeds = np.arange(-rates.v, rates.v + SPEED_STEP / 2, SPEED_STEP)
    speeds = speeds[speeds > -SPEED_STEP] if forward else speeds
    rows = [(speed, *profile) for profile in profiles for speed in speeds.tolist()]
    turns = turn_table(np.array(rows), rates)
    # Turns are moved by up to 2 * HALF steps to either side; values outside the table are discarded later.
    beyond = (2 * HALF - 1) * FINE
    across = turns.across.reshape(-1, ENTRIES)
    wide = np.pad(across[:, :-1], ((0, 0), (beyond, beyond + 2 * FINE)), mode="edge").astype(np.float32)
    filled = ((0, 0), (0, WIDTH - 2 * HALF - 1))
    fractions = np.pad(wide.reshape(len(wide), -1, FINE).swapaxes(1, 2), ((0, 0), *filled))
    return TurnTables(turns, fractions, float(speeds[0]), len(speeds))


class Shape(NamedTuple):
    """One shape of path: turn, drive straight, turn, run straight to the goal.

    `share` gives the speed between last turn and run. For a run of a given length it goes from the least (0)
    to the greatest (1) speed from which the run can reach its end speed; for a run as long as needed it is a
    share of the limit. NaN: there is no run.
    """

    first_change: float  # m/s^2; change of speed in the first turn, up to the limit
    first_rate: float  # rad/s; its greatest turn rate
    last_change: float  # those of the last turn as seen from the goal, backward in time
    last_rate: float
    share: float = 0.0
    entry: float = np.nan  # m/s; reached on a straight line before the first turn, NaN: there is none
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

    If `free_heading`, any heading at the destination will do: there is no last turn, and the drive ends when
    the object in front of the robot is there.
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
    others: NDArray[np.intp]  # shape (groups + 1,); first row of the others of each group, and the end
    tables: TurnTables
    missed: tuple[float, float]  # time (s) and angle (rad) for ends too near each other for any path


def shape_set(groups: Sequence[Sequence[Shape]], rules: Rules) -> ShapeSet:
    """Return a set of shapes in groups: the others are tried where the first one is the fastest."""
    shapes = [group[0] for group in groups]
    shapes += itertools.chain.from_iterable(group[1:] for group in groups)
    profiles = tuple(dict.fromkeys(profile for shape in shapes for profile in (shape[:2], shape[2:4])))
    tables = turn_tables(rules.rates, profiles, forward=rules.forward)
    first_row = {profile: number * tables.speeds for number, profile in enumerate(profiles)}
    rows = [(*shape, first_row[shape[:2]], first_row[shape[2:4]]) for shape in shapes]
    sizes = [len(groups), *(len(group) - 1 for group in groups)]
    turned = 2.0 * math.pi if rules.forward else math.pi
    missed = 2.0 * float(turn_time(turned, rules.rates.w, rules.rates.aw)), 2.0 * turned
    return ShapeSet(rules, np.array(rows, dtype=_SHAPE), np.cumsum(sizes, dtype=np.intp), tables, missed)


_END = np.dtype([("speed", float), ("length", float), ("time", float), ("row", np.intp)])
"""An end of a path: speed (m/s) at the turn, length (m) and time (s) of the straight part, row of turn."""


@compiled
def _set_speed(entries: Rows, speed: float, shapes: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the start of all shapes for a speed (m/s); times are infinite if that is too low."""
    rates = rules.rates
    for index in range(len(shapes)):
        shape, entry = shapes[index], entries[index]
        reached = speed if math.isnan(shape["entry"]) else shape["entry"]
        entry["speed"], entry["length"] = reached, change_distance(speed, reached, rates)
        entry["time"] = np.inf if speed < shape["least_start"] else change_time(speed, reached, rates)
        entry["row"] = _row_of(tables, shape["first_row"], reached)


@compiled
def _set_arrival(exits: Rows, arrival: float, shapes: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the end of all shapes for a speed (m/s) at the destination, as `_set_speed` does."""
    rates, square = rules.rates, arrival * arrival
    for index in range(len(shapes)):
        shape, exit_ = shapes[index], exits[index]
        share, speed, run = shape["share"], arrival, 0.0  # where the run begins
        if not math.isnan(share) and math.isnan(rules.run):
            speed = share * rates.v
            change = speed * speed - square
            run = max(change * (0.5 / rates.brake), change * (-0.5 / rates.a))
        elif not math.isnan(share):
            greatest = min(math.sqrt(square + 2.0 * rates.brake * rules.run), rates.v)
            least = math.sqrt(max(square - 2.0 * rates.a * rules.run, 0.0))
            speed, run = least + share * (greatest - least), rules.run
        exit_["speed"], exit_["length"] = speed, run
        gaining, steady, losing, _ = forward_parts(run, speed, arrival, rates)
        exit_["time"] = np.inf if arrival < shape["least_arrival"] else gaining + losing + steady
        exit_["row"] = _row_of(tables, shape["last_row"], speed)


@compiled
def fastest_paths(ends: FloatArray, shapes: ShapeSet, hold: float) -> FloatArray:
    """Return the fastest path of these shapes for each of n pairs of ends.

    Parameters
    ----------
    ends : ndarray, shape (5, n)
        Both ends, in the frame of the start: destination x, y of the axle in m and heading there in rad,
        forward speeds at the start and at the destination in m/s.
    hold : float
        Distance in m from the destination to the object in front of it.

    Returns
    -------
    ndarray, shape (2, n)
        Their times in s, and the sums of the angles of both turns in rad.
    """
    rules, rows, others, tables, missed = shapes
    result = np.empty((2, ends.shape[1]))
    count = len(others) - 1
    entries, exits = np.empty(len(rows), dtype=_END), np.empty(len(rows), dtype=_END)
    gaps, zeros = np.empty(WIDTH, dtype=np.float32), np.zeros(WIDTH, dtype=np.float32)
    firsts, first_entries, first_exits = rows[:count], entries[:count], exits[:count]
    # Speeds at both ends for which the others of each group are written
    written_for = np.full((2, count), np.nan)
    likely = 0  # the last fastest group is tried first: its time prunes most others
    for at in range(ends.shape[1]):
        x, y, turn, speed, arrival = ends[0, at], ends[1, at], ends[2, at], ends[3, at], ends[4, at]
        if at == 0 or speed != ends[3, at - 1]:
            _set_speed(first_entries, speed, firsts, tables, rules)
        if at == 0 or arrival != ends[4, at - 1]:
            _set_arrival(first_exits, arrival, firsts, tables, rules)
        time, turned, likely = _fastest(
            x, y, turn, hold, np.inf, likely, first_entries, first_exits, gaps, zeros, firsts, tables, rules
        )
        if others[likely] < others[likely + 1]:
            begin, end = others[likely], others[likely + 1]
            group, other_entries, other_exits = rows[begin:end], entries[begin:end], exits[begin:end]
            if speed != written_for[0, likely]:
                _set_speed(other_entries, speed, group, tables, rules)
            if arrival != written_for[1, likely]:
                _set_arrival(other_exits, arrival, group, tables, rules)
            written_for[0, likely], written_for[1, likely] = speed, arrival
            faster, angles, _ = _fastest(
                x, y, turn, hold, time, 0, other_entries, other_exits, gaps, zeros, group, tables, rules
            )
            if faster < time:
                time, turned = faster, angles
        if time == np.inf:
            time, turned = missed
        result[0, at], result[1, at] = time, turned
    return result


_DETOUR, _SHORTFALL = 7.2, 2.0
"""Costs, in m of driving at full speed, of each m by which a drive is too near to an object at the goal, and
of each m that a drive forward is too short for its change of speed: then the robot turns at other speeds."""
_SPARE = 0.02  # m by which a drive must exceed its change of speed if there is no last turn to compensate
_MOST_TURNED = math.radians(450.0)  # sum of both turns


@inlined
def _fastest(
    x: float,
    y: float,
    turn: float,
    hold: float,
    most: float,
    likely: int,
    entries: Rows,
    exits: Rows,
    gaps: RealArray,
    zeros: RealArray,
    shapes: Rows,
    tables: TurnTables,
    rules: Rules,
) -> tuple[float, float, int]:
    """Return time (s), turned angle (rad) and shape of the fastest path; infinite unless below `most`."""
    cos, sin = math.cos(turn), math.sin(turn)
    object_x, object_y = x + hold * cos, y + hold * sin
    # The whole change of heading may be in either direction, or a full turn more.
    whole = 0.0 if rules.free_heading else turn
    circle = math.copysign(math.tau, whole)
    totals = (whole, whole - circle, whole + circle)
    w, aw = rules.rates.w, rules.rates.aw
    least = (turn_time(abs(whole), w, aw), turn_time(abs(totals[1]), w, aw), turn_time(abs(totals[2]), w, aw))
    windows = (_window_of(-totals[0]), _window_of(-totals[1]), _window_of(-totals[2]))
    best, result, turned, fastest = most, np.inf, 0.0, likely
    turns, fractions = tables.turns, tables.fractions
    for number in range(len(shapes)):
        index = likely + number
        index -= len(shapes) if index >= len(shapes) else 0  # a remainder takes longer
        shape, entry, exit_ = shapes[index], entries[index], exits[index]
        straight = entry["time"] + exit_["time"]
        if straight >= best:
            continue
        one = Turn(entry["row"], entry["speed"], shape["first_change"], shape["first_rate"])
        two = Turn(exit_["row"], exit_["speed"], shape["last_change"], shape["last_rate"])
        ahead, aside = object_x - entry["length"], object_y
        if rules.free_heading:
            offset = Offset(ahead, aside, hold)
        else:
            back = exit_["length"]
            offset = Offset(x - entry["length"] - back * cos, y - back * sin, 0.0)
        for around in range(1 if rules.free_heading else 3 if rules.forward else 2):
            if straight + least[around] > best:
                continue
            total = totals[around]
            if rules.free_heading:
                far = zeros
            else:
                fraction, column = windows[around]
                far = fractions[two.row, fraction, column : column + WIDTH]
            # Lateral errors at the last turn of drives after each first turn, in the shape's direction;
            # `far` holds the lateral offsets of the last turns.
            near, direction = fractions[one.row, 0, 2 * HALF : 2 * HALF + WIDTH], shape["direction"]
            along_x, along_y, above = np.float32(offset.x), np.float32(offset.y), np.uint32(0)
            for step in range(WIDTH):
                gap = direction * (along_y * _COS32[step] - along_x * _SIN32[step] - near[step] - far[step])
                gaps[step] = gap
                above |= sign_bit(gap, step)
            roots = crossings(int(above), 2 * HALF, False)
            while roots:
                step = lowest(roots)
                roots &= roots - 1
                beyond = np.float64(_STEP * (gaps[step] / (gaps[step] - gaps[step + 1])))
                first = _TURNS[step] + beyond
                last = 0.0 if rules.free_heading else total - first
                angles = abs(first) + abs(last)
                if abs(last) < WIDEST and angles < _MOST_TURNED:
                    time = _time(
                        step, beyond, last, straight, best, offset, ahead, aside, one, two, turns, rules
                    )
                    if time < best:
                        best, result, turned, fastest = time, time, angles, index
    return result, turned, fastest


@inlined
def _cos_sin(step: int, beyond: float) -> tuple[float, float]:
    """Return cosine and sine of `_TURNS[step] + beyond`, for 0 to `STEP` rad beyond, to 1e-12, by series."""
    x = beyond * beyond
    cos = 1.0 - x * (1 / 2 - x * (1 / 24 - x * (1 / 720 - x * (1 / 40320 - x * (1 / 3628800)))))
    sin = beyond * (1.0 - x * (1 / 6 - x * (1 / 120 - x * (1 / 5040 - x * (1 / 362880)))))
    return _COS[step] * cos - _SIN[step] * sin, _SIN[step] * cos + _COS[step] * sin


@inlined
def _time(
    step: int,
    beyond: float,
    last: float,
    straight: float,
    best: float,
    offset: Offset,
    ahead: float,
    aside: float,
    one: Turn,
    two: Turn,
    turns: TurnTable,
    rules: Rules,
) -> float:
    """Return the time in s of a path; infinite if it is not allowed or exceeds `best`.

    The first turn is `_TURNS[step] + beyond`. The object at the goal lies `ahead` and `aside` (m) of where
    that turn begins.
    """
    (along, across), rates, first = turns, rules.rates, _TURNS[step] + beyond
    result = turn_time(abs(first), one.rate, rates.aw) + turn_time(abs(last), two.rate, rates.aw) + straight
    if result > best:
        return np.inf
    cos, sin = _cos_sin(step, beyond)
    length, before, after = drive_between(first, last, cos, sin, offset, one, two, along, along, rates)
    if result + abs(length) * (1.0 / rates.v) > best:
        return np.inf
    if rules.forward:
        least = change_distance(before, after, rates)
        if length < (least + _SPARE if rules.free_heading else 0.0):
            return np.inf
        result += _SHORTFALL / rates.v * max(least - length, 0.0)
        length = max(length, least)
    result += drive_time(length, before, after, rates)
    if rules.passing > 0.0:
        to_object = cos * ahead + sin * aside - look_up(along, one.row, first)
        to_object -= one.speed * turn_time(abs(first), one.rate, rates.aw)
        if min(length, 0.0) < to_object < max(length, 0.0):
            beside = cos * aside - sin * ahead - look_up(across, one.row, first)
            result += _DETOUR / rates.v * max(rules.passing - abs(beside), 0.0)
    return float(result)


_GROUPS, _OTHERS = 16, 24
"""Greatest numbers of groups, and of other shapes in each; the time of a search grows with both."""
_NEAR = 0.0005  # choosing ends when times exceed those of the whole grid by less than this share on average
_LATE = 3.0  # multiple of the least time where no chosen shape reaches the destination


def needed_shapes(grid: ShapeSet, ends: FloatArray, *, hold: float) -> list[list[int]]:
    """Return groups of the shapes, by index in a grid of groups of one, that are needed between ends.

    The next shape is the one that reduces the times most. It takes a second for a grid of a thousand shapes;
    for `ends`, shape (5, n), and `hold` see `fastest_paths`.
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

    Directions are uniform. Half of the distances are scaled down at random. The same share as in `like`
    begins, and ends, at rest; other speeds are uniform in its range.
    """
    some = like[:, rng.integers(0, like.shape[1], count)]
    distance = np.hypot(some[0], some[1]) * np.where(rng.random(count) < 0.5, rng.random(count), 1.0)
    bearing, turn = rng.uniform(-np.pi, np.pi, (2, count))
    moving = rng.random((2, count)) < (like[3:] != 0.0).mean(axis=1)[:, None]
    least, greatest = like[3:].min(axis=1)[:, None], like[3:].max(axis=1)[:, None]
    speeds = moving * rng.uniform(least, greatest, (2, count))
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), turn, *speeds))
