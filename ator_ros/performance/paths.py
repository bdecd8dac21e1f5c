"""Times of turn-straight-turn paths at the limits that were observed of a base: features for any action.

A path turns, drives straight and turns again, forward or backward, to either side, while the speed is
constant or changes evenly. The fastest of many such paths counts. The limits, whether the action drives
backward, and how it approaches a held object are estimated from odometry (`ator_ros.performance.training`).

All combinations of entries and exits are candidates. Each entry and each exit is evaluated once, at the first
guess of the straight's direction. That bounds the time of each pair. Only pairs that can still be the fastest
are evaluated further, which costs a third of evaluating all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from ator_ros.compiled import compiled, parallel_for, unlocked
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import Rates, change_distance, change_time, drive_time, rates_of, turn_parts
from ator_ros.motion.families import Motions
from ator_ros.performance.driving import LEVELS, DrivingStyle
from ator_ros.performance.tree.nodes import IntArray

_FULL_TURN = 2.0 * math.pi
_STEPS = 5  # of the search for the direction of the straight; more change nothing that matters
_OFF = 0.02  # m beside the goal at which a path counts as found
_EARLY = 0.02  # m that a forward drive may be too short for its change of speed
_DETOUR = 6.0  # s for each m that a straight drive passes too near
TURNING, TURNED, MOVED = 1.0, 0.1, 0.5
"""By how much the turns may change, in rad per rad that the straight is off and in rad at first, and the
straight, in m per rad, until it meets both turns."""
_SLOW = 0.6  # share of the acceleration below which a start at low speed does not turn forward
_FIRST = 4  # pairs evaluated in the order of their bounds; the others in index order
_CHUNK = 12  # least number of ends per chunk: 60 microseconds
_ANGLES = 257  # of a table of turns, from 0 to a full turn
_MOMENTS = 96  # at which a turn is summed up
_RATES = 12  # tables, of equally spaced turn rates up to the limit
_SLOWEST = 3  # twelfths of the turn rate; slower turns are not used
_SIDES = (1, -1)
_CHANGES = (-1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0)  # of speed in a turn, in shares of the limits
_GAINS = (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0)  # the same where the base never drives backward
_LEADS = (0.1, 0.2, 0.35, 0.55)  # speeds to reach before the first turn, in shares of the limit
_RUN_SPEEDS = (0.0, 0.3, 0.6, 0.9)  # at which a run of given length begins, from least to greatest
_ARRIVALS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.55, 0.75, 0.95)  # the same in shares of the limit, other runs
_LOSSES = (0.5, 0.9)  # of speed in the last turn before them
_TIGHT = 0.1  # m, radius of the tightest turn at a steady speed where the base never drives backward


class Entry(NamedTuple):
    """How a path begins: side of the turn (1 left), direction of the straight, speed, table of turns.

    `lead` is the speed to reach straight before the turn (negative: turn at once), `gain` the share of the
    acceleration in it.
    """

    side: float
    direction: float
    lead: float
    gain: float
    table: int


class Exit(NamedTuple):
    """How a path ends, seen from the goal: `arrival` and `loss` are as `lead` and `gain` of an entry."""

    side: float
    arrival: float
    loss: float
    table: int


class PathRules(NamedTuple):
    """Parameters of all candidates: rates, run in m (negative: as long as needed), whether all drive forward.

    `passing` is the distance in m to keep from the point `hold` m ahead of the goal; `least` the speed in m/s
    below which a steady turn is too tight.
    """

    rates: Rates
    run: float
    forward: bool
    passing: float
    hold: float
    least: float


@compiled
def positive_angle(angle: float) -> float:
    """Return an angle in rad brought to 0 to 2 pi."""
    return angle - _FULL_TURN * math.floor(angle / _FULL_TURN)


@compiled
def after_turn(
    table: FloatArray, angle: float, side: float, speed: float, share: float, rates: Rates, forward: bool
) -> tuple[float, float, float, float]:
    """Return time (s), displacement along and across (m) and speed after a turn that changes it evenly."""
    at = angle * ((len(table) - 1) / _FULL_TURN)
    row = min(int(at), len(table) - 2)
    upper = at - row
    lower = 1.0 - upper
    time = lower * table[row, 0] + upper * table[row + 1, 0]
    change = share * (rates.a if share * (speed + 1e-9 * share) > 0.0 else rates.brake)
    per_time = 1.0 / max(time, 1e-6)
    change = min(max(change, (-rates.v - speed) * per_time), (rates.v - speed) * per_time)
    if forward:
        change = max(change, -speed * per_time)
    along = speed * (lower * table[row, 1] + upper * table[row + 1, 1])
    along += change * (lower * table[row, 3] + upper * table[row + 1, 3])
    across = speed * (lower * table[row, 2] + upper * table[row + 1, 2])
    across += change * (lower * table[row, 4] + upper * table[row + 1, 4])
    return time, along, side * across, speed + change * time


@compiled
def run_up(arrival: float, final: float, rules: PathRules) -> tuple[float, float, float]:
    """Return time (s) and length (m) of the straight run at the end, and the speed (m/s) at its beginning."""
    rates = rules.rates
    if rules.run < 0.0:
        speed = arrival * rates.v
        return change_time(speed, final, rates), abs(change_distance(speed, final, rates)), speed
    run = rules.run
    lowest = math.sqrt(max(final * final - 2.0 * rates.a * run, 0.0))
    highest = min(math.sqrt(final * final + 2.0 * rates.brake * run), rates.v)
    speed = lowest + arrival * (highest - lowest)
    return (drive_time(run, speed, final, rates) if run > 0.0 else 0.0), run, speed


@compiled
def enters(entry: Entry, speed: float, rules: PathRules) -> bool:
    """Return whether a path can begin so at a speed (m/s)."""
    if entry.lead >= 0.0:
        return speed >= 0.0
    return not (rules.forward and abs(entry.gain) < _SLOW and speed < rules.least)


@compiled
def least_turn_time(turn: float, time: float, angle: float, rate: float) -> float:
    """Return a lower bound in s of the time of a turn whose angle (rad) may still change by `turn`."""
    return 0.0 if angle > _FULL_TURN - turn else max(time - turn / rate, 0.0)


@compiled
def secant_step(off: float, missed: float, last: float) -> float:
    """Return the next change of a heading that is `off` rad, and was `missed` rad before the `last` one."""
    if abs(missed - off) > 1e-9:
        change = off * last / (missed - off)
        return change if abs(change) < 1.0 else min(max(off, -0.7), 0.7)
    return off


@compiled
def detour_time(x: float, y: float, heading: float, distance: float, passing: float) -> float:
    """Return the additional time (s) of a straight of `distance` m that keeps `passing` m from a point.

    The point lies x, y (m) from the beginning of the straight, which leads in the direction `heading`.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    nearest = x * cos + y * sin
    nearest = min(max(nearest, min(distance, 0.0)), max(distance, 0.0))
    gap = math.hypot(x - nearest * cos, y - nearest * sin)
    return _DETOUR * max(passing - gap, 0.0)


@compiled
def lead_in(lead: float, speed: float, rates: Rates) -> tuple[float, float, float]:
    """Return time (s) and length (m) of the straight before the first turn, and the speed (m/s) after it."""
    if lead < 0.0:
        return 0.0, 0.0, speed
    reached = lead * rates.v
    return change_time(speed, reached, rates), abs(change_distance(speed, reached, rates)), reached


@compiled
def candidate_time(
    end: FloatArray, entry: Entry, last_turn: Exit, rules: PathRules, tables: FloatArray, most: float
) -> tuple[float, float]:
    """Return time (s) and angle turned (rad) of one candidate; infinite if it misses the goal.

    Parameters
    ----------
    end : ndarray, shape (5,)
        The goal ahead and to the left in m, the turn to it in rad, speeds at start and goal in m/s.
    entry, last_turn, rules
        The candidate.
    tables : ndarray, shape (k, m, 5)
        See `ator_ros.performance.paths.turn_table`.
    most : float
        Time in s from which on the candidate is abandoned.
    """
    rates = rules.rates
    backing = Rates(rates.v, rates.w, rates.brake, rates.a, rates.aw)
    turn = end[2]
    spent, ahead, speed = lead_in(entry.lead, end[3], rates)
    time, run, arrival = run_up(last_turn.arrival, end[4], rules)
    spent += time
    rate1 = rates.w * (entry.table + 1) / len(tables)
    rate2 = rates.w * (last_turn.table + 1) / len(tables)
    cos, sin = math.cos(turn), math.sin(turn)
    goal_x, goal_y = end[0] - ahead - run * cos, end[1] - run * sin
    heading = math.atan2(entry.direction * goal_y, entry.direction * goal_x)
    before, missed, total = heading, 0.0, 0.0
    for step in range(_STEPS + 1):
        first = positive_angle(entry.side * heading + 1e-7)
        last = positive_angle(last_turn.side * (turn - heading) + 1e-7)
        time1, x1, y1, speed1 = after_turn(
            tables[entry.table], first, entry.side, speed, entry.gain, rates, rules.forward
        )
        time2, x2, y2, speed2 = after_turn(
            tables[last_turn.table], last, -last_turn.side, arrival, last_turn.loss, backing, rules.forward
        )
        total = spent + time1 + time2
        if step >= 2 and total >= most:
            return np.inf, 0.0
        dx, dy = goal_x - x1 - (cos * x2 - sin * y2), goal_y - y1 - (sin * x2 + cos * y2)
        if step == _STEPS:
            break
        # A secant step toward the direction in which the straight meets both turns.
        bearing = math.atan2(entry.direction * dy, entry.direction * dx)
        off = positive_angle(bearing - heading + math.pi) - math.pi
        near = min(abs(off), 1.0)
        change = TURNING * near + (TURNED if step == 0 else 0.0)
        bound = least_turn_time(change, time1, first, rate1) + least_turn_time(change, time2, last, rate2)
        if spent + bound + max(math.hypot(dx, dy) - MOVED * near, 0.0) / rates.v >= most:
            return np.inf, 0.0
        if step > 0 and abs(off) < 1e-3:
            break
        change = off if step == 0 else secant_step(off, missed, heading - before)
        before, missed, heading = heading, off, heading + change
    cos1, sin1 = math.cos(heading), math.sin(heading)
    distance, beside = dx * cos1 + dy * sin1, abs(dy * cos1 - dx * sin1)
    if beside > _OFF:
        return np.inf, 0.0
    if rules.forward and distance < abs(change_distance(speed1, speed2, rates)) - _EARLY:
        return np.inf, 0.0
    total += drive_time(distance, speed1, speed2, rates) + beside / rates.v
    if rules.passing > 0.0:
        point_x, point_y = end[0] + rules.hold * cos - ahead - x1, end[1] + rules.hold * sin - y1
        total += detour_time(point_x, point_y, heading, distance, rules.passing)
    return total, first + last


class PathCandidates(NamedTuple):
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
    candidates: PathCandidates,
    first: int,
    run: int,
    rules: PathRules,
    tables: FloatArray,
    bounds: FloatArray,
) -> None:
    """Write to `bounds` (n, m) the bounds in s of the entries of one lead with the exits of one run."""
    rates = rules.rates
    backing = Rates(rates.v, rates.w, rates.brake, rates.a, rates.aw)
    sample = _entry(candidates.entries[candidates.leads[first]])
    turn = end[2]
    spent, ahead, speed = lead_in(sample.lead, end[3], rates)
    _, length, _ = run_up(candidates.exits[candidates.runs[run], 1], end[4], rules)
    cos, sin = math.cos(turn), math.sin(turn)
    goal_x, goal_y = end[0] - ahead - length * cos, end[1] - length * sin
    heading = math.atan2(sample.direction * goal_y, sample.direction * goal_x)
    along, across = math.cos(heading), math.sin(heading)
    begin, stop = candidates.leads[first], candidates.leads[first + 1]
    begun = np.empty((stop - begin, 5))
    for number in range(begin, stop):
        entry = _entry(candidates.entries[number])
        angle = positive_angle(entry.side * heading + 1e-7)
        time, x, y, _ = after_turn(
            tables[entry.table], angle, entry.side, speed, entry.gain, rates, rules.forward
        )
        row = begun[number - begin]
        row[0], row[1], row[2], row[3] = time, x, y, angle
        row[4] = rates.w * (entry.table + 1) / len(tables) if enters(entry, end[3], rules) else 0.0
    for number in range(candidates.runs[run], candidates.runs[run + 1]):
        exit_ = _exit(candidates.exits[number])
        before, _, arrival = run_up(exit_.arrival, end[4], rules)
        angle = positive_angle(exit_.side * (turn - heading) + 1e-7)
        time, x, y, _ = after_turn(
            tables[exit_.table], angle, -exit_.side, arrival, exit_.loss, backing, rules.forward
        )
        rest_x, rest_y = goal_x - (cos * x - sin * y), goal_y - (sin * x + cos * y)
        rate = rates.w * (exit_.table + 1) / len(tables)
        for other in range(stop - begin):
            row = begun[other]
            if row[4] == 0.0:
                continue
            dx, dy = rest_x - row[1], rest_y - row[2]
            forward = sample.direction * (dx * along + dy * across)
            off = min(abs(dy * along - dx * across) / forward, 1.0) if forward > 0.0 else 1.0
            change = TURNING * off + TURNED
            bound = least_turn_time(change, row[0], row[3], row[4])
            bound += least_turn_time(change, time, angle, rate)
            straight = max(math.sqrt(dx * dx + dy * dy) - MOVED * off, 0.0) / rates.v
            bounds[begin + other, number] = spent + before + bound + straight


@compiled
def _least(bounds: FloatArray) -> tuple[int, int]:
    first, last = 0, 0
    for entry in range(bounds.shape[0]):
        for exit_ in range(bounds.shape[1]):
            if bounds[entry, exit_] < bounds[first, last]:
                first, last = entry, exit_
    return first, last


@compiled
def _fastest(
    end: FloatArray, candidates: PathCandidates, rules: PathRules, tables: FloatArray, bounds: FloatArray
) -> tuple[float, float]:
    """Return the least time in s of all candidates to one end, and the angle turned on it in rad."""
    bounds[:] = np.inf
    for run in range(len(candidates.runs) - 1):
        for first in range(len(candidates.leads) - 1):
            if candidates.entries[candidates.leads[first], 2] < 0.0 or end[3] >= 0.0:
                _bound_pairs(end, candidates, first, run, rules, tables, bounds)
    best, angle = np.inf, 0.0
    for _ in range(_FIRST):
        first, last = _least(bounds)
        if bounds[first, last] < best:
            pair = _entry(candidates.entries[first]), _exit(candidates.exits[last])
            time, around = candidate_time(end, pair[0], pair[1], rules, tables, best)
            bounds[first, last] = np.inf
            if time < best:
                best, angle = time, around
    for first in range(bounds.shape[0]):
        for last in range(bounds.shape[1]):
            if bounds[first, last] < best:
                pair = _entry(candidates.entries[first]), _exit(candidates.exits[last])
                time, around = candidate_time(end, pair[0], pair[1], rules, tables, best)
                if time < best:
                    best, angle = time, around
    return best, angle


@unlocked
def fastest_paths(
    ends: FloatArray,
    candidates: PathCandidates,
    rules: PathRules,
    tables: FloatArray,
    times: FloatArray,
    turns: FloatArray,
    first: int,
    end: int,
) -> None:
    """Write the least time in s to each of `ends` (n, 5), and the angle turned on that path in rad.

    Only those from `first` to `end` are computed.
    """
    bounds = np.empty((len(candidates.entries), len(candidates.exits)))
    for row in range(first, end):
        times[row], turns[row] = _fastest(ends[row], candidates, rules, tables, bounds)


@lru_cache(maxsize=64)
def turn_table(rate: float, aw: float) -> FloatArray:
    """Return what turns do, by angle, at up to `rate` (rad/s), from and to no rotation.

    Returns
    -------
    ndarray, shape (_ANGLES, 5)
        Time (s), and the integrals over it of cosine, sine, time x cosine and time x sine of the heading:
        with speed v at the start and acceleration a, v times the first two plus a times the last two is the
        way.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, _ANGLES)[:, None]
    ramp, steady = turn_parts(angles, rate, aw)
    whole, peak = 2.0 * ramp + steady, aw * ramp
    time = whole * (np.arange(_MOMENTS) + 0.5) / _MOMENTS
    middle = 0.5 * peak * ramp + peak * (time - ramp)
    early, late = 0.5 * aw * time * time, angles - 0.5 * aw * (whole - time) ** 2
    heading = np.where(time < ramp, early, np.where(time > whole - ramp, late, middle))
    parts = (np.cos(heading), np.sin(heading), time * np.cos(heading), time * np.sin(heading))
    return np.column_stack([whole, *(part.mean(axis=1, keepdims=True) * whole for part in parts)])


@lru_cache(maxsize=32)
def _tables(rate: float, aw: float) -> FloatArray:
    return np.stack([turn_table(rate * (number + 1) / _RATES, aw) for number in range(_RATES)])


@lru_cache(maxsize=64)
def _candidates(driving: DrivingStyle, *, holding: bool) -> PathCandidates:
    """Return all combinations of entries and exits for a driving style."""
    full = _RATES - 1
    if driving.backward:
        begins = [(-1.0, gain, full) for gain in _CHANGES]
    else:
        begins = [(-1.0, gain, full) for gain in _GAINS]
        begins += [(lead, 0.0, _number(driving.steady, lead)) for lead in _LEADS]
    if driving.run is None and holding:
        ends = [(speed, 0.0, _number(driving.steady, speed)) for speed in _ARRIVALS]
        ends += [(speed, loss, _number(driving.braking, speed)) for speed in _ARRIVALS for loss in _LOSSES]
    else:
        speeds = _RUN_SPEEDS if holding and driving.run else (0.0,)
        changes = _CHANGES if driving.backward else (-0.5, 0.0, 0.5, 1.0)
        ends = [(speed, change, full) for speed in speeds for change in changes]
    entries = [
        Entry(side, direction, *begin)
        for direction in ((1, -1) if driving.backward else (1,))
        for begin in begins
        for side in _SIDES
        if begin[-1] >= _SLOWEST - 1
    ]
    exits = [Exit(side, *end) for end in sorted(ends) for side in _SIDES if end[-1] >= _SLOWEST - 1]
    leads = _changes([(entry.direction, entry.lead) for entry in entries])
    runs = _changes([exit_.arrival if driving.run is None and holding else 0.0 for exit_ in exits])
    rows = [
        np.array(candidates, dtype=float).reshape(-1, len(kind._fields))
        for candidates, kind in ((entries, Entry), (exits, Exit))
    ]
    return PathCandidates(rows[0], leads, rows[1], runs)


def _changes(values: Sequence[object]) -> IntArray:
    """Return where values differ from those before them, and where they end."""
    first = [index for index, value in enumerate(values) if index == 0 or value != values[index - 1]]
    return np.array([*first, len(values)], dtype=np.intp)


def _number(shares: tuple[float, ...], speed: float) -> int:
    """Return which table of turns holds at a speed, a share of the limit; -1 for none."""
    return round(_RATES * min(shares[min(int(speed * LEVELS), LEVELS - 1)], 1.0)) - 1


def path_times(ends: FloatArray, driving: DrivingStyle, *, hold: float, holding: bool) -> Motions:
    """Return time and angle of the fastest paths.

    Parameters
    ----------
    ends : ndarray, shape (n, 5)
        Where the axle shall come, ahead and to the left in m, the turn to its heading there in rad, and the
        speeds at start and goal in m/s.
    driving : DrivingStyle
        How the action drives.
    hold : float
        Distance in m from the axle to what the robot holds.
    holding : bool
        Whether it shall hold something at the goal.

    Returns
    -------
    Motions
        Infinite times where none of the paths leads to the goal.
    """
    rates = rates_of(driving.limits)
    run = (-1.0 if driving.run is None else driving.run) if holding else 0.0
    passing = driving.passing if holding else 0.0
    rules = PathRules(rates, run, not driving.backward, passing, hold, _TIGHT * rates.w)
    times, turns = np.full(len(ends), np.inf), np.zeros(len(ends))
    candidates = _candidates(driving, holding=holding)
    if not (len(candidates.entries) and len(candidates.exits)):  # it turns too slowly at all speeds
        return Motions(times, turns)
    search = partial(fastest_paths, ends, candidates, rules, _tables(rates.w, rates.aw), times, turns)
    parallel_for(search, len(ends), _CHUNK)
    return Motions(times, turns)
