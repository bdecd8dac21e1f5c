"""The fastest of a set of turn-drive-turn paths, for many pairs of ends at once: a feature of the models.

A shape of path is a turn, a straight drive, a turn and a straight run, with given changes of speed. Shapes
come in groups: the first of each group is tried for all ends, the others of a group where its first one is
the fastest. `needed_shapes` chooses groups from a fine grid: the next shape is that which brings the times
nearest to those of the whole grid.

The search is compiled, since it dominates refinement. The heading of the drive is the only unknown: its roots
are bracketed on a grid of first turns, where the parts of both turns just add. Tables, computed once per
set, give the ends of turns. Paths whose lower bound exceeds the best time are skipped.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled, inlined
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import (
    Rates,
    change_distance,
    change_time,
    drive_time,
    forward_time,
    rates_of,
    turn_time,
)
from ator_ros.motion.paths import drive_length, speed_after
from ator_ros.motion.turns import (
    ENTRIES,
    FINE,
    HALF,
    STEP,
    WIDEST,
    TurnTable,
    look_up,
    place_of,
    turn_table,
)
from ator_ros.robot.description import Limits

Rows = NDArray[np.void]
RealArray = NDArray[np.floating[Any]]

SPEED_STEP = 0.02  # m/s
WIDTH = 32  # columns of the tables in which all of TURNS are looked up at once: whole vectors
TURNS: FloatArray = STEP * np.arange(-HALF, HALF + 1, dtype=float)


class TurnProfile(NamedTuple):
    """How a turn is driven: change of speed in m/s^2, up to the limit, and greatest turn rate in rad/s."""

    change: float
    rate: float


class TurnTables(NamedTuple):
    """The table of turns with some profiles, each at speeds up to the limit, both ways.

    Attributes
    ----------
    turns : TurnTable
        A row for each profile and speed.
    fractions : ndarray, shape (rows, FINE, columns)
        The column `across`, rearranged so that entries of turns one step apart are contiguous, for each
        entry to begin with; see `_window_of`.
    lowest : float
        First speed in m/s: 0 where the robot never drives backward.
    speeds : int
        Number of speeds.
    """

    turns: TurnTable
    fractions: RealArray
    lowest: float
    speeds: int


@compiled
def _row_of(tables: TurnTables, profile: int, speed: float) -> int:
    """Return the row of turns with a profile that start at `speed` (m/s)."""
    row = int((speed - tables.lowest) * (1.0 / SPEED_STEP) + 0.5)
    return profile * tables.speeds + min(max(row, 0), tables.speeds - 1)


@compiled
def _window_of(moved: float) -> tuple[int, int]:
    """Return where in a row of `fractions` TURNS moved by `moved` (rad, within 540 degrees) begin."""
    place = int(2 * HALF * FINE + 0.5 + moved * (FINE / STEP))
    return place % FINE, place // FINE


@lru_cache(maxsize=6)
def turn_tables(limits: Limits, profiles: tuple[TurnProfile, ...], *, forward: bool = False) -> TurnTables:
    """Compute the tables of `profiles` for a robot's limits: 3 MB for each m/s and profile."""
    speeds = np.arange(-limits.v, limits.v + SPEED_STEP / 2, SPEED_STEP)
    speeds = speeds[speeds > -SPEED_STEP] if forward else speeds
    rows = [(speed, *profile) for profile in profiles for speed in speeds.tolist()]
    turns = turn_table(np.array(rows), limits)
    # TURNS moved by up to 2 * HALF steps to either side; values beyond the table are discarded later.
    beyond = (2 * HALF - 1) * FINE
    across = turns.across.reshape(-1, ENTRIES)
    wide = np.pad(across[:, :-1], ((0, 0), (beyond, beyond + 2 * FINE)), mode="edge").astype(np.float32)
    filled = ((0, 0), (0, WIDTH - len(TURNS)))
    fractions = np.pad(wide.reshape(len(wide), -1, FINE).swapaxes(1, 2), ((0, 0), *filled))
    return TurnTables(turns, fractions, float(speeds[0]), len(speeds))


_DETOUR, _SHORTFALL = 7.2, 2.0
"""Costs, in m of driving at full speed, of each m that a drive passes an object at the goal too near, and of
each m that a drive forward lacks for its change of speed: the robot turns at other speeds then."""


class Shape(NamedTuple):
    """One shape of path: turn, drive straight, turn, run straight to the goal.

    Attributes
    ----------
    first, last : TurnProfile
        How the turns are driven; the last as seen from the goal, backward in time.
    share : float
        Speed between last turn and run. For a run of a given length: from the least (0) to the greatest (1)
        speed from which it can reach its end speed; for one as long as needed: a share of the limit. NaN
        without a run.
    entry : float
        Speed in m/s to reach in a straight lead before the first turn; NaN where that begins at once.
    least_start, least_arrival : float
        Least speeds in m/s at the start and at the goal of such paths.
    direction : float
        1 if the drive between the turns goes forward, -1 if backward.
    """

    first: TurnProfile
    last: TurnProfile
    share: float = 0.0
    entry: float = np.nan
    least_start: float = -np.inf
    least_arrival: float = -np.inf
    direction: float = 1.0


SHAPE = np.dtype(
    [("first_profile", np.intp), ("last_profile", np.intp)]
    + [(f"{turn}_{what}", float) for turn in ("first", "last") for what in TurnProfile._fields]
    + [(name, float) for name in ("share", "entry", "least_start", "least_arrival")]
    + [("direction", np.float32)],
    align=True,
)
"""A shape of path as a row."""


class Rules(NamedTuple):
    """Parameters of all shapes of a set; see `ShapeSet`.

    run: NaN if it is as long as needed. detour, shortfall: cost in s of each m by which a drive passes too
    near the object, and by which a drive forward is too short for its change of speed.
    """

    rates: Rates
    run: float
    passing: float
    detour: float
    shortfall: float
    forward: bool
    free_heading: bool


@dataclass(frozen=True)
class ShapeSet:
    """Shapes of paths, of which the fastest counts.

    Attributes
    ----------
    groups : tuple of tuple of Shape
        The first of each group is tried for all ends, the others where their first one is the fastest.
    run : float or None
        Length in m of the straight run at the end; None where it is as long as its change of speed needs.
    passing : float
        Distance in m that the straight drive keeps from an object at the goal; 0 where there is none.
    forward : bool
        Whether the robot never drives backward.
    free_heading : bool
        Whether the heading at the destination does not matter: there is no last turn, and the drive leads the
        object in front of the robot there.
    """

    limits: Limits
    groups: tuple[tuple[Shape, ...], ...]
    run: float | None = 0.0
    passing: float = 0.0
    forward: bool = False
    free_heading: bool = False

    @cached_property
    def _shapes(self) -> tuple[Shape, ...]:
        """All shapes: the first ones of all groups, then the others group by group."""
        others = itertools.chain.from_iterable(group[1:] for group in self.groups)
        return (*(group[0] for group in self.groups), *others)

    @cached_property
    def _profiles(self) -> tuple[TurnProfile, ...]:
        return tuple(dict.fromkeys(each for shape in self._shapes for each in (shape.first, shape.last)))

    @cached_property
    def tables(self) -> TurnTables:
        """The tables of all ways to turn."""
        return turn_tables(self.limits, self._profiles, forward=self.forward)

    @cached_property
    def rows(self) -> Rows:
        """The shapes as rows: the first ones of all groups, then the others group by group."""
        number = self._profiles.index
        rows = [
            (number(shape.first), number(shape.last), *shape.first, *shape.last, *shape[2:])
            for shape in self._shapes
        ]
        return np.array(rows, dtype=SHAPE)

    @cached_property
    def others(self) -> NDArray[np.intp]:
        """The rows at which the other shapes of each group begin, and the end, shape (groups + 1,)."""
        sizes = [len(self.groups), *(len(group) - 1 for group in self.groups)]
        return np.cumsum(np.array(sizes, dtype=np.intp))

    @cached_property
    def missed(self) -> tuple[float, float]:
        """Time (s) and angle (rad) where the ends are so near each other that no path has room."""
        turned = 2.0 * np.pi if self.forward else np.pi
        return float(2.0 * turn_time(turned, self.limits.w, self.limits.aw)), 2.0 * turned

    @cached_property
    def rules(self) -> Rules:
        """What holds for all shapes."""
        run = np.nan if self.run is None else self.run
        costs = _DETOUR / self.limits.v, _SHORTFALL / self.limits.v
        return Rules(rates_of(self.limits), run, self.passing, *costs, self.forward, self.free_heading)


_END = np.dtype([("speed", float), ("length", float), ("time", float), ("row", np.intp)])
"""One end of a shape's paths: speed (m/s) at the turn, length (m) and time (s) of the straight part between
the end and the turn, and the turn's row in the tables."""


@compiled
def _set_speed(entries: Rows, speed: float, shapes: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the first ends of all shapes for a speed (m/s) at the start; infinite times if it is too low."""
    rates = rules.rates
    for index in range(len(shapes)):
        shape, entry = shapes[index], entries[index]
        reached = speed if math.isnan(shape["entry"]) else shape["entry"]
        entry["speed"], entry["length"] = reached, change_distance(speed, reached, rates)
        entry["time"] = change_time(speed, reached, rates) if speed >= shape["least_start"] else np.inf
        entry["row"] = _row_of(tables, shape["first_profile"], reached)


@compiled
def _set_arrival(exits: Rows, arrival: float, shapes: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the last ends of all shapes for a speed (m/s) at the destination, as `_set_speed` does."""
    for index in range(len(shapes)):
        shape, exit_ = shapes[index], exits[index]
        speed, run = _before_run(shape["share"], arrival, rules)
        exit_["speed"], exit_["length"] = speed, run
        time = forward_time(run, speed, arrival, rules.rates)
        exit_["time"] = time if arrival >= shape["least_arrival"] else np.inf
        exit_["row"] = _row_of(tables, shape["last_profile"], speed)


@compiled
def _before_run(share: float, arrival: float, rules: Rules) -> tuple[float, float]:
    """Return speed (m/s) and distance (m) to the goal where the straight run begins."""
    rates, square = rules.rates, arrival * arrival
    if math.isnan(share):
        return arrival, 0.0
    if math.isnan(rules.run):
        speed = share * rates.v
        change = speed * speed - square
        return speed, max(change * (0.5 / rates.brake), change * (-0.5 / rates.a))
    greatest = min(math.sqrt(square + 2.0 * rates.brake * rules.run), rates.v)
    least = math.sqrt(max(square - 2.0 * rates.a * rules.run, 0.0))
    return least + share * (greatest - least), rules.run


_ROOM = 0.02
"""Room in m that a drive needs beyond its change of speed if no last turn can make up for it."""
_FULL_TURN = 2.0 * math.pi
_MOST_TURNED = math.radians(450.0)
_STEP = np.float32(STEP)

# TURNS, padded to fill the processor's vectors.
_WIDE = STEP * np.arange(-HALF, WIDTH - HALF)
_COS, _SIN = np.cos(_WIDE.astype(np.float32)), np.sin(_WIDE.astype(np.float32))
_BITS = (1 << np.arange(WIDTH)).astype(np.uint32)
_INSIDE = (1 << 2 * HALF) - 1  # all turns but the last


class _Offset(NamedTuple):
    """From where the first turn begins to where the last one ends, and to the object at the goal, in m.

    The drive ends `before` m ahead of where the last turn begins.
    """

    x: float
    y: float
    object_x: float
    object_y: float
    before: float


@compiled
def search_fastest(
    ends: FloatArray,
    shapes: Rows,
    others: NDArray[np.intp],
    tables: TurnTables,
    rules: Rules,
    missed: tuple[float, float],
    hold: float,
    result: FloatArray,
) -> None:
    """Find the fastest path for each of n pairs of ends.

    Parameters
    ----------
    ends : ndarray, shape (5, n)
        See `fastest_paths`.
    shapes, others, tables, rules
        Those of a `ShapeSet`.
    missed : tuple of float
        Time (s) and angle (rad) that stand for ends between which no path has room.
    hold : float
        See `fastest_paths`.
    result : ndarray, shape (2, n)
        Becomes the time in s, and the sum of the angles turned in rad.
    """
    count = len(others) - 1
    firsts, most = shapes[:count], max(1, (others[1:] - others[:-1]).max())
    entries, exits = np.empty(count, dtype=_END), np.empty(count, dtype=_END)
    other_entries, other_exits = np.empty(most, dtype=_END), np.empty(most, dtype=_END)
    gaps, zeros = np.empty(WIDTH, dtype=np.float32), np.zeros(WIDTH, dtype=np.float32)
    likely = 0  # the last fastest group is tried first: its time prunes most others
    for at in range(ends.shape[1]):
        x, y, turn, speed, arrival = ends[0, at], ends[1, at], ends[2, at], ends[3, at], ends[4, at]
        if at == 0 or speed != ends[3, at - 1]:
            _set_speed(entries, speed, firsts, tables, rules)
        if at == 0 or arrival != ends[4, at - 1]:
            _set_arrival(exits, arrival, firsts, tables, rules)
        time, turned, likely = _fastest(
            x, y, turn, hold, np.inf, likely, entries, exits, gaps, zeros, firsts, tables, rules
        )
        if others[likely] < others[likely + 1]:
            group = shapes[others[likely] : others[likely + 1]]
            _set_speed(other_entries, speed, group, tables, rules)
            _set_arrival(other_exits, arrival, group, tables, rules)
            faster, angles, _ = _fastest(
                x, y, turn, hold, time, 0, other_entries, other_exits, gaps, zeros, group, tables, rules
            )
            if faster < time:
                time, turned = faster, angles
        if time == np.inf:
            time, turned = missed
        result[0, at], result[1, at] = time, turned


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
    # The whole change of heading may be either way round, or a full turn more.
    circle = math.copysign(_FULL_TURN, turn)
    totals = (turn, turn - circle, turn + circle)
    windows = (_window_of(-totals[0]), _window_of(-totals[1]), _window_of(-totals[2]))
    best, result, turned, fastest = most, np.inf, 0.0, likely
    along, across = tables.turns
    for number in range(len(shapes)):
        index = (likely + number) % len(shapes)
        shape, entry, exit_ = shapes[index], entries[index], exits[index]
        straight = entry["time"] + exit_["time"]
        if straight == np.inf:
            continue
        ahead, aside = object_x - entry["length"], object_y
        if rules.free_heading:
            offset = _Offset(ahead, aside, ahead, aside, hold)
        else:
            to_x, to_y = x - entry["length"] - exit_["length"] * cos, y - exit_["length"] * sin
            offset = _Offset(to_x, to_y, ahead, aside, 0.0)
        rate = max(shape["first_rate"], shape["last_rate"])
        for around in range(1 if rules.free_heading else 3 if rules.forward else 2):
            total = 0.0 if rules.free_heading else totals[around]
            if straight + turn_time(abs(total), rate, rules.rates.aw) > best:
                continue
            if rules.free_heading:
                far = zeros
            else:
                fraction, column = windows[around]
                far = tables.fractions[exit_["row"], fraction, column : column + WIDTH]
            above = _fill_gaps(gaps, offset, shape["direction"], entry, far, tables)
            # At a zero crossing from above the drive has this shape's direction, else the opposite one.
            roots = above & ~(above >> 1) & _INSIDE
            while roots:
                step = math.frexp(float(roots & -roots))[1] - 1
                roots &= roots - 1
                first = TURNS[step] + _STEP * (gaps[step] / (gaps[step] - gaps[step + 1]))
                last = 0.0 if rules.free_heading else total - first
                angles = abs(first) + abs(last)
                if abs(last) < WIDEST and angles < _MOST_TURNED:
                    time = _time(
                        first, last, straight, best, offset, shape, entry, exit_, along, across, rules
                    )
                    if time < best:
                        best, result, turned, fastest = time, time, angles, index
    return result, turned, fastest


@inlined
def _fill_gaps(
    gaps: RealArray,
    offset: _Offset,
    direction: float,
    entry: Any,
    far: RealArray,
    tables: TurnTables,
) -> int:
    """Compute by how much a drive after each of TURNS misses the last turn, in the shape's direction.

    `far` is how far across the last turns begin. Return a number whose bits are set for gaps above 0, which
    is faster to scan.
    """
    x, y = np.float32(offset.x), np.float32(offset.y)
    near = tables.fractions[entry["row"], 0, 2 * HALF : 2 * HALF + WIDTH]  # at TURNS
    above = np.uint32(0)
    for step in range(WIDTH):
        gap = direction * (y * _COS[step] - x * _SIN[step] - near[step] - far[step])
        gaps[step] = gap
        above |= _BITS[step] if gap > np.float32(0.0) else np.uint32(0)
    return int(above)


@inlined
def _time(
    first: float,
    last: float,
    straight: float,
    best: float,
    offset: _Offset,
    shape: Any,
    entry: Any,
    exit_: Any,
    along: FloatArray,
    across: FloatArray,
    rules: Rules,
) -> float:
    """Return the time in s of a path; infinite if it is not allowed or exceeds `best`."""
    rates = rules.rates
    time1 = turn_time(abs(first), shape["first_rate"], rates.aw)
    time2 = turn_time(abs(last), shape["last_rate"], rates.aw)
    result: float = time1 + time2 + straight
    if result > best:
        return np.inf
    cos, sin = math.cos(first), math.sin(first)
    coasted = entry["speed"] * time1
    lane = cos * offset.x + sin * offset.y - offset.before - coasted - exit_["speed"] * time2
    length = drive_length(lane, first, last, entry["row"], exit_["row"], along, along)
    if result + abs(length) * (1.0 / rates.v) > best:
        return np.inf
    before = speed_after(entry["speed"], shape["first_change"], time1, rates.v)
    after = speed_after(exit_["speed"], shape["last_change"], time2, rates.v)
    if rules.forward:
        least = change_distance(before, after, rates)
        if length < (least + _ROOM if rules.free_heading else 0.0):
            return np.inf
        result += rules.shortfall * max(least - length, 0.0)
        length = max(length, least)
    result += drive_time(length, before, after, rates)
    if rules.passing > 0.0:
        begin, share = place_of(entry["row"], first)
        to_object = cos * offset.object_x + sin * offset.object_y - look_up(along, begin, share) - coasted
        if min(length, 0.0) < to_object < max(length, 0.0):
            beside = cos * offset.object_y - sin * offset.object_x - look_up(across, begin, share)
            result += rules.detour * max(rules.passing - abs(beside), 0.0)
    return result


_GROUPS, _OTHERS = 16, 24
"""Greatest numbers of groups, and of other shapes in each; the time of a search grows with both."""
_NEAR = 0.0005
"""Choosing ends when times are longer than those of the whole grid by less than this share on average."""
_LATE = 3.0  # multiple of the least time, where no chosen shape leads to the destination


def needed_shapes(grid: ShapeSet, ends: FloatArray, *, hold: float) -> list[list[int]]:
    """Return groups of shapes, by their places in a grid of groups of one, that are needed between ends.

    Parameters
    ----------
    grid : ShapeSet
        With all shapes to choose from; it takes a second for a thousand.
    ends : ndarray, shape (5, n)
        See `fastest_paths`.
    hold : float
        Distance in m from the destination to the object in front of it.
    """
    count = ends.shape[1]
    times, result = np.empty((len(grid.rows), count)), np.empty((2, count))
    alone, never = np.ones(2, dtype=np.intp), (np.inf, 0.0)
    for number in range(len(times)):
        row = grid.rows[number : number + 1]
        search_fastest(ends, row, alone, grid.tables, grid.rules, never, hold, result)
        times[number] = result[0]
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
    """Choose shapes by the ratios (shapes, n) of their times to the least: which saves the most is next."""
    chosen: list[int] = []
    while len(chosen) < most and so_far.sum() > (1.0 + _NEAR) * len(so_far):
        chosen.append(int(np.argmin(np.minimum(so_far, ratios).sum(axis=1))))
        so_far = np.minimum(so_far, ratios[chosen[-1]])
    return chosen


def drawn_ends(like: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Return ends of paths in all directions, (5, count), with the distances and speeds of others, (5, n).

    Half of the distances are scaled down at random. As many as of the others begin, and end, at rest; other
    speeds are evenly spread.
    """
    some = like[:, rng.integers(0, like.shape[1], count)]
    distance = np.hypot(some[0], some[1]) * np.where(rng.random(count) < 0.5, rng.random(count), 1.0)
    bearing, turn = rng.uniform(-np.pi, np.pi, (2, count))
    moving = rng.random((2, count)) < (like[3:] != 0.0).mean(axis=1)[:, None]
    least, greatest = like[3:].min(axis=1)[:, None], like[3:].max(axis=1)[:, None]
    speeds = moving * rng.uniform(least, greatest, (2, count))
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), turn, *speeds))


def fastest_paths(ends: FloatArray, shapes: ShapeSet, *, hold: float) -> FloatArray:
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
    result = np.empty((2, ends.shape[1]))
    search_fastest(ends, shapes.rows, shapes.others, shapes.tables, shapes.rules, shapes.missed, hold, result)
    return result
