"""The search for the fastest way to drive, compiled where numba is there.

All combinations of entries and exits are candidates. Each entry and each exit is evaluated once, at the first
guess of the straight's direction. That bounds the time of each pair. Only pairs that can still be the fastest
are evaluated further, which costs a third of evaluating all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ator_ros.compiled import compiled, unlocked
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import Rates
from ator_ros.performance.compiled_paths import (
    MOVED,
    TURNED,
    TURNING,
    Entry,
    Exit,
    PathRules,
    enters,
    lead_in,
    positive_angle,
    run_up,
    turned,
    turned_back,
    way_time,
)
from ator_ros.performance.tree.nodes import IntArray

_FIRST = 4  # pairs that are followed in the order of their bounds; the others come as they are


class PathWays(NamedTuple):
    """All combinations of entries and exits.

    `entries` (n, 5) and `exits` (m, 4) hold the fields of `Entry` and `Exit`. Entries from `leads[i]` to
    `leads[i + 1]` begin with the same lead and direction, exits from `runs[i]` to `runs[i + 1]` end with the
    same run.
    """

    entries: FloatArray
    leads: IntArray
    exits: FloatArray
    runs: IntArray


@compiled
def _entry(row: FloatArray) -> Entry:
    return Entry(row[0], row[1], row[2], row[3], int(row[4]))


@compiled
def _exit(row: FloatArray) -> Exit:
    return Exit(row[0], row[1], row[2], int(row[3]))


@compiled
def _bound_pairs(
    end: FloatArray,
    ways: PathWays,
    first: int,
    run: int,
    rules: PathRules,
    tables: FloatArray,
    bounds: FloatArray,
) -> None:
    """Write to `bounds` (n, m) the bounds in s of the entries of one lead with the exits of one run."""
    rates = rules.rates
    backing = Rates(rates.v, rates.w, rates.brake, rates.a, rates.aw)
    sample = _entry(ways.entries[ways.leads[first]])
    turn = end[2]
    spent, ahead, speed = lead_in(sample.lead, end[3], rates)
    _, length, _ = run_up(ways.exits[ways.runs[run], 1], end[4], rules)
    cos, sin = math.cos(turn), math.sin(turn)
    goal_x, goal_y = end[0] - ahead - length * cos, end[1] - length * sin
    heading = math.atan2(sample.direction * goal_y, sample.direction * goal_x)
    along, across = math.cos(heading), math.sin(heading)
    begin, stop = ways.leads[first], ways.leads[first + 1]
    begun = np.empty((stop - begin, 5))
    for number in range(begin, stop):
        entry = _entry(ways.entries[number])
        angle = positive_angle(entry.side * heading + 1e-7)
        time, x, y, _ = turned(
            tables[entry.table], angle, entry.side, speed, entry.gain, rates, rules.forward
        )
        row = begun[number - begin]
        row[0], row[1], row[2], row[3] = time, x, y, angle
        row[4] = rates.w * (entry.table + 1) / len(tables) if enters(entry, end[3], rules) else 0.0
    for number in range(ways.runs[run], ways.runs[run + 1]):
        leave = _exit(ways.exits[number])
        before, _, arrival = run_up(leave.arrival, end[4], rules)
        angle = positive_angle(leave.side * (turn - heading) + 1e-7)
        time, x, y, _ = turned(
            tables[leave.table], angle, -leave.side, arrival, leave.loss, backing, rules.forward
        )
        rest_x, rest_y = goal_x - (cos * x - sin * y), goal_y - (sin * x + cos * y)
        rate = rates.w * (leave.table + 1) / len(tables)
        for other in range(stop - begin):
            row = begun[other]
            if row[4] == 0.0:
                continue
            dx, dy = rest_x - row[1], rest_y - row[2]
            forward = sample.direction * (dx * along + dy * across)
            off = min(abs(dy * along - dx * across) / forward, 1.0) if forward > 0.0 else 1.0
            change = TURNING * off + TURNED
            bound = turned_back(change, row[0], row[3], row[4]) + turned_back(change, time, angle, rate)
            straight = max(math.sqrt(dx * dx + dy * dy) - MOVED * off, 0.0) / rates.v
            bounds[begin + other, number] = spent + before + bound + straight


@compiled
def _least(bounds: FloatArray) -> tuple[int, int]:
    first, last = 0, 0
    for entry in range(bounds.shape[0]):
        for leave in range(bounds.shape[1]):
            if bounds[entry, leave] < bounds[first, last]:
                first, last = entry, leave
    return first, last


@compiled
def _fastest(
    end: FloatArray, ways: PathWays, rules: PathRules, tables: FloatArray, bounds: FloatArray
) -> tuple[float, float]:
    """Return the least time in s of all ways to one end, and the angle turned on it in rad."""
    bounds[:] = np.inf
    for run in range(len(ways.runs) - 1):
        for first in range(len(ways.leads) - 1):
            if ways.entries[ways.leads[first], 2] < 0.0 or end[3] >= 0.0:
                _bound_pairs(end, ways, first, run, rules, tables, bounds)
    best, angle = np.inf, 0.0
    for _ in range(_FIRST):
        first, last = _least(bounds)
        if bounds[first, last] < best:
            way = _entry(ways.entries[first]), _exit(ways.exits[last])
            time, around = way_time(end, way[0], way[1], rules, tables, best)
            bounds[first, last] = np.inf
            if time < best:
                best, angle = time, around
    for first in range(bounds.shape[0]):
        for last in range(bounds.shape[1]):
            if bounds[first, last] < best:
                way = _entry(ways.entries[first]), _exit(ways.exits[last])
                time, around = way_time(end, way[0], way[1], rules, tables, best)
                if time < best:
                    best, angle = time, around
    return best, angle


@unlocked
def fastest_ways(
    ends: FloatArray,
    ways: PathWays,
    rules: PathRules,
    tables: FloatArray,
    times: FloatArray,
    turns: FloatArray,
    first: int,
    end: int,
) -> None:
    """Write the least time in s of all `ways` to each of `ends` (n, 5), and the angle turned on it in rad.

    Only those from `first` to `end` are computed.
    """
    bounds = np.empty((len(ways.entries), len(ways.exits)))
    for row in range(first, end):
        times[row], turns[row] = _fastest(ends[row], ways, rules, tables, bounds)
