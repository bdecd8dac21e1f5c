"""A single manoeuvre in compiled code: its pieces, and the first turn with which it meets its goal.

The same formulas as in `profiles`, `displacements`, `manoeuvre` and `bundle`, to rounding.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.motion.displacements import NODES, WEIGHTS
from ator_ros.motion.manoeuvre import STEPS, TOLERANCE

PIECES = 13
"""Pieces of the translational velocity: three of a straight, two of a turn, three, two, three."""
_SURE = 8  # steps after which rounding may have led elsewhere


class Bounds(NamedTuple):
    """Limits that the kernel uses, in m/s, m/s^2, m/s^2 and rad/s^2."""

    v: float
    a: float
    brake: float
    aw: float


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
def turn_time(angle: float, rate: float, aw: float) -> float:
    """Return the time in s of a turn; see `profiles.turn_times`."""
    size = abs(angle)
    return 2.0 * math.sqrt(size / aw) if size <= rate * rate / aw else size / rate + rate / aw


@compiled
def displacement(angle: float, side: FloatArray, bounds: Bounds) -> Turned:
    """Return where a turn ends that is driven as `side`, shape (5,), says; see `displacements`."""
    aw, time = bounds.aw, turn_time(angle, side[4], bounds.aw)
    size = max(abs(angle), 1e-12)
    whole = turn_time(size, side[4], aw)
    peak = min(side[4], math.sqrt(size * aw))
    ramp = peak / aw
    x = y = 0.0
    for node in range(len(NODES)):
        t = NODES[node] * whole
        rest = whole - t
        if t < ramp:
            done = 0.5 * aw * t * t
        elif rest < ramp:
            done = size - 0.5 * aw * rest * rest
        else:
            done = peak * (t - 0.5 * ramp)
        heading = angle * (done / size)
        speed = min(max(side[2] + side[3] * (time * NODES[node]), -bounds.v), bounds.v)
        step = speed * WEIGHTS[node] * time
        x += step * math.cos(heading)
        y += step * math.sin(heading)
    return Turned(x, y)


@compiled
def gap(
    first: float, last: float, start: End, goal: End, entry: FloatArray, leaving: FloatArray, bounds: Bounds
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
    first: float, last: float, start: End, goal: End, entry: FloatArray, leaving: FloatArray, bounds: Bounds
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
def _straight(pieces: FloatArray, at: int, distance: float, v1: float, v2: float, bounds: Bounds) -> None:
    """Write three pieces (duration, speeds at both ends) of a drive; see `profiles.straight_pieces`."""
    rate = bounds.a if v2 >= v1 else bounds.brake
    surplus = distance - (v1 + v2) * abs(v2 - v1) / (2.0 * rate)
    sign = 1.0 if surplus >= (1e-9 if max(v1, v2) < 0.0 else -1e-9) else -1.0
    d, u1, u2, up, down = sign * distance, sign * v1, sign * v2, bounds.a, bounds.brake
    squares = (down * u1 * u1 + up * u2 * u2 + 2.0 * up * down * d) / (up + down)
    most = max(u1, u2)
    peak = min(math.sqrt(max(squares, most * most if most > 0.0 else 0.0)), bounds.v)
    ramps = (peak * peak - u1 * u1) / (2.0 * up) + (peak * peak - u2 * u2) / (2.0 * down)
    _piece(pieces, at, (peak - u1) / up, v1, sign * peak)
    _piece(pieces, at + 1, max(d - ramps, 0.0) / bounds.v, sign * peak, sign * peak)
    _piece(pieces, at + 2, (peak - u2) / down, sign * peak, v2)


@compiled
def _piece(pieces: FloatArray, at: int, duration: float, begin: float, end: float) -> None:
    pieces[at, 0], pieces[at, 1], pieces[at, 2] = duration, begin, end


@compiled
def _ramp(angle: float, side: FloatArray, bounds: Bounds) -> tuple[float, float, float]:
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
    bounds: Bounds,
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
    bounds: Bounds,
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
    peak = min(rate, math.sqrt(abs(angle) * aw))
    cruise = max(0.0, abs(angle) / peak - peak / aw) if peak > 0.0 else 0.0
    signed = math.copysign(peak, angle)
    _piece(turns, at, peak / aw, 0.0, signed)
    _piece(turns, at + 1, cruise, signed, signed)
    _piece(turns, at + 2, peak / aw, signed, 0.0)
