"""One way to drive between two poses, turn, straight and turn: compiled where numba is there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import Rates, change_distance, change_time, drive_time

_FULL_TURN = 2.0 * math.pi
_STEPS = 5  # of the search for the direction of the straight; more change nothing that matters
_OFF = 0.02  # m beside the goal at which a path counts as found
_EARLY = 0.02  # m that a forward drive may be too short for its change of speed
_WAY_ROUND = 6.0  # s for each m that a straight drive passes too near
TURNING, TURNED, MOVED = 1.0, 0.1, 0.5
"""By how much the turns may change, in rad per rad that the straight is off and in rad at first, and the
straight, in m per rad, until it meets both turns."""
_SLOW = 0.6  # share of the acceleration below which a start at low speed does not turn forward


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
    """What holds for all ways: rates, run in m (negative: as long as needed), and whether all are forward.

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
def turned(
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
def turned_back(turn: float, time: float, angle: float, rate: float) -> float:
    """Return a bound in s on the time of a turn whose angle (rad) may yet change by `turn`."""
    return 0.0 if angle > _FULL_TURN - turn else max(time - turn / rate, 0.0)


@compiled
def secant_step(off: float, missed: float, last: float) -> float:
    """Return the next change of a heading that is `off` rad, and was `missed` rad before the `last` one."""
    if abs(missed - off) > 1e-9:
        change = off * last / (missed - off)
        return change if abs(change) < 1.0 else min(max(off, -0.7), 0.7)
    return off


@compiled
def way_round(x: float, y: float, heading: float, distance: float, passing: float) -> float:
    """Return the time (s) that a straight of `distance` m takes longer if it keeps `passing` m from a point.

    The point lies x, y (m) from the beginning of the straight, which leads in the direction `heading`.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    nearest = x * cos + y * sin
    nearest = min(max(nearest, min(distance, 0.0)), max(distance, 0.0))
    gap = math.hypot(x - nearest * cos, y - nearest * sin)
    return _WAY_ROUND * max(passing - gap, 0.0)


@compiled
def lead_in(lead: float, speed: float, rates: Rates) -> tuple[float, float, float]:
    """Return time (s) and length (m) of the straight before the first turn, and the speed (m/s) after it."""
    if lead < 0.0:
        return 0.0, 0.0, speed
    reached = lead * rates.v
    return change_time(speed, reached, rates), abs(change_distance(speed, reached, rates)), reached


@compiled
def way_time(
    end: FloatArray, entry: Entry, last_turn: Exit, rules: PathRules, tables: FloatArray, most: float
) -> tuple[float, float]:
    """Return time (s) and angle turned (rad) of one way to drive; infinite where it misses the goal.

    Parameters
    ----------
    end : ndarray, shape (5,)
        The goal ahead and to the left in m, the turn to it in rad, speeds at start and goal in m/s.
    entry, last_turn, rules
        What to drive.
    tables : ndarray, shape (k, m, 5)
        See `ator_ros.performance.paths.turn_table`.
    most : float
        Time in s from which on a way does not matter.
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
        time1, x1, y1, speed1 = turned(
            tables[entry.table], first, entry.side, speed, entry.gain, rates, rules.forward
        )
        time2, x2, y2, speed2 = turned(
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
        bound = turned_back(change, time1, first, rate1) + turned_back(change, time2, last, rate2)
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
        total += way_round(point_x, point_y, heading, distance, rules.passing)
    return total, first + last
