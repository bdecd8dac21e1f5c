"""A single manoeuvre in compiled code: its pieces, and the first turn with which it meets its goal.

The same formulas as in `durations`, `displacements` and `manoeuvre`, to rounding.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion.displacements import NODES, WEIGHTS
from ator_ros.motion.durations import Rates, drive_parts, turn_parts, turn_time
from ator_ros.motion.manoeuvre import STEPS, TOLERANCE

PIECES = 13
"""Pieces of the translational velocity: three of a straight, two of a turn, three, two, three."""
_SURE = 8  # steps after which rounding may have led elsewhere


class End(NamedTuple):
    """A pose: x, y in m, yaw in rad."""

    x: float
    y: float
    yaw: float


class Turned(NamedTuple):
    """A displacement in m, forward and leftward."""

    x: float
    y: float


@compiled
def displacement(angle: float, side: FloatArray, bounds: Rates) -> Turned:
    """Return where a turn driven as `side`, shape (5,), ends; see `displacements`."""
    aw, time = bounds.aw, turn_time(angle, side[4], bounds.aw)
    size = max(abs(angle), 1e-12)
    ramp, steady = turn_parts(size, side[4], aw)
    whole = 2.0 * ramp + steady
    x = y = 0.0
    for node in range(len(NODES)):
        t = NODES[node] * whole
        rest = whole - t
        if t < ramp:
            done = 0.5 * aw * t * t
        elif rest < ramp:
            done = size - 0.5 * aw * rest * rest
        else:
            done = aw * ramp * (t - 0.5 * ramp)
        heading = angle * (done / size)
        speed = min(max(side[2] + side[3] * (time * NODES[node]), -bounds.v), bounds.v)
        step = speed * WEIGHTS[node] * time
        x += step * math.cos(heading)
        y += step * math.sin(heading)
    return Turned(x, y)


@compiled
def gap(
    first: float, last: float, start: End, goal: End, entry: FloatArray, leaving: FloatArray, bounds: Rates
) -> Turned:
    """Return the length of the drive between two turns, and how far it misses the last one sideways, in m."""
    one, two = displacement(first, entry, bounds), displacement(-last, leaving, bounds)
    ahead, back = entry[0] + one.x, -leaving[0] - two.x
    c, s = math.cos(start.yaw), math.sin(start.yaw)
    begin_x, begin_y = start.x + c * ahead - s * one.y, start.y + s * ahead + c * one.y
    c, s = math.cos(goal.yaw), math.sin(goal.yaw)
    dx = goal.x + c * back + s * two.y - begin_x
    dy = goal.y + s * back - c * two.y - begin_y
    c, s = math.cos(start.yaw + first), math.sin(start.yaw + first)
    return Turned(c * dx + s * dy, c * dy - s * dx)


@compiled
def close(
    first: float, last: float, start: End, goal: End, entry: FloatArray, leaving: FloatArray, bounds: Rates
) -> tuple[float, float, float, bool]:
    """Solve for the first turn as `manoeuvre.closed` does.

    Returns both turns in rad, the drive in m, and whether it was found, for sure.
    """
    x0, x1, total = first, first + 1e-4, first + last
    f0 = gap(x0, total - x0, start, goal, entry, leaving, bounds).y
    found = gap(x1, total - x1, start, goal, entry, leaving, bounds)
    for step in range(STEPS):
        if abs(found.y) < TOLERANCE:
            return x1, total - x1, found.x, step < _SURE
        if found.y == f0:
            break
        change = min(max(-found.y * (x1 - x0) / (found.y - f0), -0.2), 0.2)
        x0, f0 = x1, found.y
        x1 += change
        found = gap(x1, total - x1, start, goal, entry, leaving, bounds)
    return x1, total - x1, found.x, False


@compiled
def _straight(pieces: FloatArray, at: int, distance: float, v1: float, v2: float, bounds: Rates) -> None:
    """Write three pieces (duration, speeds at both ends) of a drive; see `durations.straight_pieces`."""
    gaining, steady, losing, top = drive_parts(distance, v1, v2, bounds)
    _piece(pieces, at, gaining, v1, top)
    _piece(pieces, at + 1, steady, top, top)
    _piece(pieces, at + 2, losing, top, v2)


@compiled
def _piece(pieces: FloatArray, at: int, duration: float, begin: float, end: float) -> None:
    pieces[at, 0], pieces[at, 1], pieces[at, 2] = duration, begin, end


@compiled
def _ramp(angle: float, side: FloatArray, bounds: Rates) -> tuple[float, float, float]:
    """Return how long the speed changes in a turn, how long it does not, in s, and what it reaches in m/s."""
    total = turn_time(angle, side[4], bounds.aw)
    ramp = total
    if side[3] != 0.0:
        bound = math.copysign(bounds.v, side[3])
        ramp = min(total, max(0.0, (bound - side[2]) / side[3]))
    return ramp, total - ramp, side[2] + side[3] * ramp


@compiled
def speed_pieces(
    pieces: FloatArray,
    first: float,
    last: float,
    distance: float,
    entry: FloatArray,
    leaving: FloatArray,
    bounds: Rates,
) -> float:
    """Write the velocity's pieces, shape (13, 3): duration, both speeds; return their whole time in s."""
    ramp, held, v1 = _ramp(first, entry, bounds)
    _straight(pieces, 0, entry[0], entry[1], entry[2], bounds)
    _piece(pieces, 3, ramp, entry[2], v1)
    _piece(pieces, 4, held, v1, v1)
    ramp, held, v2 = _ramp(last, leaving, bounds)
    _straight(pieces, 5, distance, v1, v2, bounds)
    _piece(pieces, 8, held, v2, v2)
    _piece(pieces, 9, ramp, v2, leaving[2])
    _straight(pieces, 10, leaving[0], leaving[2], leaving[1], bounds)
    total = 0.0
    for piece in range(PIECES):
        total += pieces[piece, 0]
    return total


@compiled
def turn_pieces(
    turns: FloatArray,
    pieces: FloatArray,
    first: float,
    last: float,
    entry: FloatArray,
    leaving: FloatArray,
    bounds: Rates,
) -> None:
    """Write the turn rate's pieces, shape (9, 3), that go with the `pieces` of the velocity."""
    _idle(turns, 0, pieces, 0)
    _turn(turns, 1, first, entry[4], bounds.aw)
    _idle(turns, 4, pieces, 5)
    _turn(turns, 5, last, leaving[4], bounds.aw)
    _idle(turns, 8, pieces, 10)


@compiled
def _idle(turns: FloatArray, at: int, pieces: FloatArray, of: int) -> None:
    _piece(turns, at, pieces[of, 0] + pieces[of + 1, 0] + pieces[of + 2, 0], 0.0, 0.0)


@compiled
def _turn(turns: FloatArray, at: int, angle: float, rate: float, aw: float) -> None:
    ramp, steady = turn_parts(angle, rate, aw)
    peak = math.copysign(aw * ramp, angle)
    _piece(turns, at, ramp, 0.0, peak)
    _piece(turns, at + 1, steady, peak, peak)
    _piece(turns, at + 2, ramp, peak, 0.0)
