"""The search for the fastest of a family's ideal motions: compiled, as it is most of a refinement's work.

A motion turns, drives straight, turns, and runs straight to the goal. The heading of the drive is the only
unknown. Its roots are bracketed on a grid of first turns, where the parts of both turns just add.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import Rates, change_distance, drive_time, forward_time, turn_time
from ator_ros.motion.turn_tables import (
    HALF,
    STEP,
    TURNS,
    WIDEST,
    RealArray,
    TurnTables,
    look_up,
    place_of,
    row_of,
    window_of,
)

_FULL_TURN = 2.0 * math.pi
_MOST_TURNED = math.radians(450.0)
_BRACKETS = 2 * HALF + 1
_COS, _SIN = np.cos(TURNS.astype(np.float32)), np.sin(TURNS.astype(np.float32))
_STEP = np.float32(STEP)
_INNER = (1 << (_BRACKETS - 1)) - 1  # the bits of all of TURNS that another one follows


KIND = np.dtype(
    [("first_way", np.intp), ("last_way", np.intp)]
    + [(f"{turn}_{what}", float) for what in ("change", "rate") for turn in ("first", "last")]
    + [("share", float), ("entry", float), ("direction", np.float32)],
    align=True,
)
"""A kind of motion as a row; see `families.Kind`."""

_LANE = np.dtype(
    [
        ("entry", float),  # speeds in m/s where the first turn begins
        ("junction", float),  # and where the last one ends
        ("lead", float),  # straight before the first turn
        ("run", float),  # and after the last one in m
        ("time", float),  # of both in s
        ("first", np.intp),  # rows of the turns in the tables
        ("last", np.intp),
    ]
)
"""What of a kind's motions depends on the speeds at both ends alone."""

Rows = NDArray[np.void]


class Rules(NamedTuple):
    """What holds for all kinds of a family; see `families.Family`.

    run: NaN where it is as long as needed. detour: s per m that a straight drive passes too near the object.
    """

    rates: Rates
    run: float
    passing: float
    detour: float
    forward: bool
    hold: float


class _Way(NamedTuple):
    """From where the first turn begins to where the last one ends, and to the object at the goal, in m."""

    x: float
    y: float
    object_x: float
    object_y: float


@compiled
def search_fastest(
    ends: FloatArray, kinds: Rows, tables: TurnTables, rules: Rules, result: FloatArray
) -> None:
    """Find the fastest motion in each of n situations.

    Parameters
    ----------
    ends : ndarray, shape (5, n)
        Destination x, y (m) and heading (rad) in the frame of the start, speeds (m/s) at both ends.
    kinds : ndarray of KIND
        The kinds of motion.
    tables, rules
        How they turn, and what holds for all of them.
    result : ndarray, shape (2, n)
        Becomes the time in s, infinite where no motion has room, and the sum of the angles turned in rad.
    """
    lanes = np.empty(len(kinds), dtype=_LANE)
    gaps = np.empty(_BRACKETS, dtype=np.float32)
    likely = 0  # what was fastest just before is tried first: then more of the others are hopeless
    for at in range(ends.shape[1]):
        speed, arrival = ends[3, at], ends[4, at]
        if at == 0 or speed != ends[3, at - 1] or arrival != ends[4, at - 1]:
            _set_speeds(lanes, speed, arrival, kinds, tables, rules)
        result[0, at], result[1, at], likely = _fastest(
            ends[0, at], ends[1, at], ends[2, at], likely, lanes, gaps, kinds, tables, rules
        )


@compiled
def _set_speeds(
    lanes: Rows, speed: float, arrival: float, kinds: Rows, tables: TurnTables, rules: Rules
) -> None:
    rates = rules.rates
    for index in range(len(kinds)):
        kind, lane = kinds[index], lanes[index]
        junction, run = _before_run(kind["share"], arrival, rules)
        entry = speed if math.isnan(kind["entry"]) else kind["entry"]
        gain = entry - speed
        leading = max(gain * (1.0 / rates.a), gain * (-1.0 / rates.brake))
        lane["entry"], lane["junction"] = entry, junction
        lane["lead"], lane["run"] = 0.5 * (entry + speed) * leading, run
        lane["time"] = leading + forward_time(run, junction, arrival, rates)
        lane["first"] = row_of(tables, kind["first_way"], entry)
        lane["last"] = row_of(tables, kind["last_way"], junction)


@compiled
def _before_run(share: float, arrival: float, rules: Rules) -> tuple[float, float]:
    """Return speed (m/s) and distance (m) to the goal where the straight run begins."""
    rates, square = rules.rates, arrival * arrival
    if math.isnan(rules.run):
        junction = share * rates.v
        change = junction * junction - square
        return junction, max(change * (0.5 / rates.brake), change * (-0.5 / rates.a))
    greatest = min(math.sqrt(square + 2.0 * rates.brake * rules.run), rates.v)
    least = math.sqrt(max(square - 2.0 * rates.a * rules.run, 0.0))
    return least + share * (greatest - least), rules.run


@compiled
def _fastest(
    x: float,
    y: float,
    turn: float,
    likely: int,
    lanes: Rows,
    gaps: RealArray,
    kinds: Rows,
    tables: TurnTables,
    rules: Rules,
) -> tuple[float, float, int]:
    """Return time (s), turned angle (rad) and kind of the fastest motion to one destination."""
    cos, sin = math.cos(turn), math.sin(turn)
    object_x, object_y = x + rules.hold * cos, y + rules.hold * sin
    # The whole change of heading may go either way round, or a circle more.
    circle = math.copysign(_FULL_TURN, turn)
    totals = (turn, turn - circle, turn + circle)
    windows = (window_of(-totals[0]), window_of(-totals[1]), window_of(-totals[2]))
    best, turned, fastest = np.inf, 0.0, likely
    for number in range(len(kinds)):
        index = (likely + number) % len(kinds)
        kind, lane = kinds[index], lanes[index]
        lead, run = lane["lead"], lane["run"]
        way = _Way(x - lead - run * cos, y - run * sin, object_x - lead, object_y)
        rate = max(kind["first_rate"], kind["last_rate"])
        for around in range(3 if rules.forward else 2):
            total = totals[around]
            if lane["time"] + turn_time(abs(total), rate, rules.rates.aw) > best:
                continue
            above = _fill_gaps(
                gaps, way, windows[around], kind["direction"], lane, tables.brackets, tables.fractions
            )
            # Through zero from above the drive then goes the way of this kind, else the other way.
            roots, step = above & ~(above >> 1) & _INNER, 0
            while roots:
                if roots & 1:
                    first = TURNS[step] + _STEP * (gaps[step] / (gaps[step] - gaps[step + 1]))
                    last = total - first
                    angles = abs(first) + abs(last)
                    if abs(last) < WIDEST and angles < _MOST_TURNED:
                        time = _time(first, last, best, way, kind, lane, tables.along, tables.across, rules)
                        if time < best:
                            best, turned, fastest = time, angles, index
                roots, step = roots >> 1, step + 1
    return best, turned, fastest


@compiled
def _fill_gaps(
    gaps: RealArray,
    way: _Way,
    window: tuple[int, int],
    direction: float,
    lane: Any,
    brackets: RealArray,
    fractions: RealArray,
) -> int:
    """Compute by how much a drive after each of TURNS misses the last turn, in the kind's direction.

    Return a number whose bits tell which of them are above 0: to check all of them in turn would take longer.
    """
    x, y, first, last = np.float32(way.x), np.float32(way.y), lane["first"], lane["last"]
    fraction, column = window
    near, far = brackets[first], fractions[last, fraction, column : column + _BRACKETS]
    above = 0
    for step in range(_BRACKETS):
        gaps[step] = direction * (y * _COS[step] - x * _SIN[step] - near[step] - far[step])
        if gaps[step] > 0.0:
            above |= 1 << step
    return above


@compiled
def _time(
    first: float,
    last: float,
    best: float,
    way: _Way,
    kind: Any,
    lane: Any,
    along: FloatArray,
    across: FloatArray,
    rules: Rules,
) -> float:
    """Return the time in s of a motion: infinite where it is not allowed, or surely above `best`."""
    rates = rules.rates
    turning1 = turn_time(abs(first), kind["first_rate"], rates.aw)
    turning2 = turn_time(abs(last), kind["last_rate"], rates.aw)
    result: float = turning1 + turning2 + lane["time"]
    if result > best:
        return np.inf
    cos, sin = math.cos(first), math.sin(first)
    begin, share = place_of(lane["first"], first)
    end, end_share = place_of(lane["last"], -last)  # the last turn is driven from the goal
    begun = look_up(along, begin, share)
    length = cos * way.x + sin * way.y - begun - look_up(along, end, end_share)
    before = min(max(lane["entry"] + kind["first_change"] * turning1, -rates.v), rates.v)
    after = min(max(lane["junction"] + kind["last_change"] * turning2, -rates.v), rates.v)
    if rules.forward:
        if length < change_distance(before, after, rates):
            return np.inf
        result += forward_time(length, before, after, rates)
    else:
        result += drive_time(length, before, after, rates)
    if rules.passing > 0.0:
        to_object = cos * way.object_x + sin * way.object_y - begun
        if min(length, 0.0) < to_object < max(length, 0.0):
            beside = cos * way.object_y - sin * way.object_x - look_up(across, begin, share)
            result += rules.detour * max(rules.passing - abs(beside), 0.0)
    return result
