"""The search for the fastest of a family's ideal motions: compiled, since it dominates refinement.

A motion turns, drives straight, turns, and runs straight to the goal. The heading of the drive is the only
unknown. Its roots are bracketed on a grid of first turns, where the parts of both turns just add. What
depends on the speeds at the ends alone is computed once.

Motions whose lower bound exceeds the best time are skipped; this changes no result.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled, inlined, unlocked
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import Rates, change_distance, change_time, drive_time, forward_time, turn_time
from ator_ros.motion.turn_tables import (
    HALF,
    STEP,
    TURNS,
    WIDEST,
    WIDTH,
    RealArray,
    TurnTables,
    look_up,
    place_of,
    row_of,
    window_of,
)

KIND = np.dtype(
    [("first_profile", np.intp), ("last_profile", np.intp)]
    + [(f"{turn}_{what}", float) for what in ("change", "rate") for turn in ("first", "last")]
    + [(name, float) for name in ("share", "entry", "least_start", "least_arrival")]
    + [("direction", np.float32)],
    align=True,
)
"""A kind of motion as a row; see `families.Kind`."""

END = np.dtype([("speed", float), ("length", float), ("time", float), ("row", np.intp)])
"""One end of a kind's motions: speed (m/s) at the turn, length (m) and time (s) of the straight part between
the end and the turn, and the turn's row in the tables."""

Rows = NDArray[np.void]


class Rules(NamedTuple):
    """Parameters of all kinds of a family; see `families.Family`.

    run: NaN if it is as long as needed. detour: s per m that a straight drive passes too near the object.
    """

    rates: Rates
    run: float
    passing: float
    detour: float
    forward: bool
    hold: float


@compiled
def set_speed(entries: Rows, speed: float, kinds: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the first ends of all kinds for a speed (m/s) at the start; infinite times if it is too low."""
    rates = rules.rates
    for index in range(len(kinds)):
        kind, entry = kinds[index], entries[index]
        reached = speed if math.isnan(kind["entry"]) else kind["entry"]
        entry["speed"], entry["length"] = reached, change_distance(speed, reached, rates)
        entry["time"] = change_time(speed, reached, rates) if speed >= kind["least_start"] else np.inf
        entry["row"] = row_of(tables, kind["first_profile"], reached)


@compiled
def set_arrival(exits: Rows, arrival: float, kinds: Rows, tables: TurnTables, rules: Rules) -> None:
    """Write the last ends of all kinds for a speed (m/s) at the destination, as `set_speed` does."""
    for index in range(len(kinds)):
        kind, exit_ = kinds[index], exits[index]
        speed, run = _before_run(kind["share"], arrival, rules)
        exit_["speed"], exit_["length"] = speed, run
        time = forward_time(run, speed, arrival, rules.rates)
        exit_["time"] = time if arrival >= kind["least_arrival"] else np.inf
        exit_["row"] = row_of(tables, kind["last_profile"], speed)


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


_FULL_TURN = 2.0 * math.pi
_MOST_TURNED = math.radians(450.0)
_STEP = np.float32(STEP)
_INNER = (1 << (2 * HALF)) - 1  # the bits of all of TURNS that another one follows
_KEPT = 32  # arrival speeds whose ends are cached: a grid has few different ones
_SLACK, _SLACK_S = 1e-5, 1e-3  # m and s: above the error of `_drive`, and its effect on a time

# TURNS, padded to fill the processor's vectors; _INNER masks the padding.
_WIDE = STEP * np.arange(-HALF, WIDTH - HALF)
_COS, _SIN = np.cos(_WIDE.astype(np.float32)), np.sin(_WIDE.astype(np.float32))
_FINE_COS, _FINE_SIN = np.cos(_WIDE), np.sin(_WIDE)
_BITS = (1 << np.arange(WIDTH)).astype(np.uint32)
_NUMBERS = np.zeros(37, dtype=np.intp)  # of bits, by the remainders of their values
_NUMBERS[(1 << np.arange(WIDTH)) % 37] = np.arange(WIDTH)


class _Offset(NamedTuple):
    """From where the first turn begins to where the last one ends, and to the object at the goal, in m."""

    x: float
    y: float
    object_x: float
    object_y: float


class _Turns(NamedTuple):
    """Angles of both turns in rad; the first lies `beyond` the one of TURNS whose number is `step`."""

    first: float
    last: float
    step: int
    beyond: float


@unlocked
def search_fastest(
    ends: FloatArray,
    kinds: Rows,
    tables: TurnTables,
    rules: Rules,
    missed: tuple[float, float],
    result: FloatArray,
    first: int,
    end: int,
) -> None:
    """Find the fastest motion in each of n situations to one of m destinations, whichever is reached first.

    Parameters
    ----------
    ends : ndarray, shape (5, m, n)
        Destination x, y (m) and heading (rad) in the frame of the start, speeds (m/s) at both ends; that at
        the start is the same for all destinations.
    kinds : ndarray of KIND
        The kinds of motion.
    tables, rules
        How they turn, and what holds for all of them.
    missed : tuple of float
        Time (s) and angle (rad) that stand for a destination to which no motion has room.
    result : ndarray, shape (2, n)
        Becomes the time in s, and the sum of the angles turned in rad.
    first, end : int
        Of which situations.
    """
    entries = np.empty(len(kinds), dtype=END)
    exits = np.empty((_KEPT, len(kinds)), dtype=END)
    arrivals = np.full(_KEPT, np.nan)
    gaps = np.empty(WIDTH, dtype=np.float32)
    likely, kept = 0, 0  # the last fastest kind is tried first: its time prunes most others
    for at in range(first, end):
        speed = ends[3, 0, at]
        if at == first or speed != ends[3, 0, at - 1]:
            set_speed(entries, speed, kinds, tables, rules)
        best, turned = np.inf, 0.0
        for choice in range(ends.shape[1]):
            arrival = ends[4, choice, at]
            kept = _place_of(arrival, arrivals, kept)
            if arrivals[kept] != arrival:
                arrivals[kept] = arrival
                set_arrival(exits[kept], arrival, kinds, tables, rules)
            x, y, turn = ends[0, choice, at], ends[1, choice, at], ends[2, choice, at]
            # Bounded by the time to another destination, unless that one was missed.
            most = best if best <= missed[0] else np.inf
            time, angles, likely = _fastest(
                x, y, turn, most, likely, entries, exits[kept], gaps, kinds, tables, rules
            )
            if time == np.inf and most == np.inf:
                time, angles = missed
            if time < best:
                best, turned = time, angles
        result[0, at], result[1, at] = best, turned


@compiled
def _place_of(arrival: float, arrivals: FloatArray, kept: int) -> int:
    """Return the place in the cache for an arrival speed; speeds mostly come in a fixed order."""
    for ahead in range(_KEPT):
        place = (kept + ahead) % _KEPT
        if arrivals[place] == arrival or math.isnan(arrivals[place]):
            return place
    return (kept + 1) % _KEPT


@inlined
def _fastest(
    x: float,
    y: float,
    turn: float,
    most: float,
    likely: int,
    entries: Rows,
    exits: Rows,
    gaps: RealArray,
    kinds: Rows,
    tables: TurnTables,
    rules: Rules,
) -> tuple[float, float, int]:
    """Return time (s), turned angle (rad) and kind of the fastest motion; infinite unless below `most`."""
    cos, sin = math.cos(turn), math.sin(turn)
    object_x, object_y = x + rules.hold * cos, y + rules.hold * sin
    # The whole change of heading may be either way round, or a full turn more.
    circle = math.copysign(_FULL_TURN, turn)
    totals = (turn, turn - circle, turn + circle)
    windows = (window_of(-totals[0]), window_of(-totals[1]), window_of(-totals[2]))
    best, result, turned, fastest = most, np.inf, 0.0, likely
    for number in range(len(kinds)):
        index = (likely + number) % len(kinds)
        kind, entry, exit_ = kinds[index], entries[index], exits[index]
        straight = entry["time"] + exit_["time"]
        if straight == np.inf:
            continue
        offset = _Offset(
            x - entry["length"] - exit_["length"] * cos,
            y - exit_["length"] * sin,
            object_x - entry["length"],
            object_y,
        )
        rate = max(kind["first_rate"], kind["last_rate"])
        for around in range(3 if rules.forward else 2):
            total = totals[around]
            if straight + turn_time(abs(total), rate, rules.rates.aw) > best:
                continue
            above = _fill_gaps(
                gaps,
                offset,
                windows[around],
                kind["direction"],
                entry,
                exit_,
                tables.brackets,
                tables.fractions,
            )
            # At a zero crossing from above the drive has this kind's direction, else the opposite one.
            roots = above & ~(above >> 1) & _INNER
            while roots:
                bit = roots & -roots
                roots ^= bit
                step = _NUMBERS[bit % 37]
                beyond = _STEP * (gaps[step] / (gaps[step] - gaps[step + 1]))
                first = TURNS[step] + beyond
                turns = _Turns(first, total - first, step, beyond)
                angles = abs(first) + abs(turns.last)
                if abs(turns.last) < WIDEST and angles < _MOST_TURNED:
                    time = _time(
                        turns, straight, best, offset, kind, entry, exit_, tables.along, tables.across, rules
                    )
                    if time < best:
                        best, result, turned, fastest = time, time, angles, index
    return result, turned, fastest


@inlined
def _fill_gaps(
    gaps: RealArray,
    offset: _Offset,
    window: tuple[int, int],
    direction: float,
    entry: Any,
    exit_: Any,
    brackets: RealArray,
    fractions: RealArray,
) -> int:
    """Compute by how much a drive after each of TURNS misses the last turn, in the kind's direction.

    Return a number whose bits are set for gaps above 0, which is faster to scan.
    """
    x, y = np.float32(offset.x), np.float32(offset.y)
    fraction, column = window
    near, far = brackets[entry["row"]], fractions[exit_["row"], fraction, column : column + WIDTH]
    above = np.uint32(0)
    for step in range(WIDTH):
        gap = direction * (y * _COS[step] - x * _SIN[step] - near[step] - far[step])
        gaps[step] = gap
        above |= _BITS[step] if gap > np.float32(0.0) else np.uint32(0)
    return int(above)


@inlined
def _time(
    turns: _Turns,
    straight: float,
    best: float,
    offset: _Offset,
    kind: Any,
    entry: Any,
    exit_: Any,
    along: FloatArray,
    across: FloatArray,
    rules: Rules,
) -> float:
    """Return the time in s of a motion; infinite if it is not allowed or exceeds `best`."""
    rates = rules.rates
    turning1 = turn_time(abs(turns.first), kind["first_rate"], rates.aw)
    turning2 = turn_time(abs(turns.last), kind["last_rate"], rates.aw)
    result: float = turning1 + turning2 + straight
    if result > best:
        return np.inf
    begin, share = place_of(entry["row"], turns.first)
    end, end_share = place_of(exit_["row"], -turns.last)  # the last turn is driven from the goal
    begun, ended = look_up(along, begin, share), look_up(along, end, end_share)
    before = min(max(entry["speed"] + kind["first_change"] * turning1, -rates.v), rates.v)
    after = min(max(exit_["speed"] + kind["last_change"] * turning2, -rates.v), rates.v)
    nearly = _drive(turns, offset) - begun - ended
    if result + abs(nearly) * (1.0 / rates.v) > best + _SLACK_S:
        return np.inf
    if _straight(nearly, _SLACK, before, after, rules) + result > best + _SLACK_S:
        return np.inf
    cos, sin = math.cos(turns.first), math.sin(turns.first)
    length = cos * offset.x + sin * offset.y - begun - ended
    result += _straight(length, 0.0, before, after, rules)
    if rules.passing > 0.0:
        to_object = cos * offset.object_x + sin * offset.object_y - begun
        if min(length, 0.0) < to_object < max(length, 0.0):
            beside = cos * offset.object_y - sin * offset.object_x - look_up(across, begin, share)
            result += rules.detour * max(rules.passing - abs(beside), 0.0)
    return result


@inlined
def _straight(length: float, slack: float, before: float, after: float, rules: Rules) -> float:
    """Return the time in s of the drive between both turns; infinite if it is too short by over `slack` m."""
    if not rules.forward:
        return drive_time(length, before, after, rules.rates)
    if length < change_distance(before, after, rules.rates) - slack:
        return np.inf
    return forward_time(length, before, after, rules.rates)


@inlined
def _drive(turns: _Turns, offset: _Offset) -> float:
    """Approximate the component of the offset, in m, along the heading after the first turn.

    Sine and cosine are short series around the nearest of TURNS, with an error below 1e-10 of the offset.
    """
    beyond = float(turns.beyond)
    square = beyond * beyond
    cos = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0 - square * (1.0 / 40320.0))))
    sin = 1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0)))
    sin *= beyond
    ahead_cos, ahead_sin = _FINE_COS[turns.step], _FINE_SIN[turns.step]
    x, y = offset.x * cos + offset.y * sin, offset.y * cos - offset.x * sin
    result: float = ahead_cos * x + ahead_sin * y
    return result
