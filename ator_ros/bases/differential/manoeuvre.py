"""A manoeuvre: straight entry, turn, straight drive, turn, straight exit, as fast as limits allow.

The functions are compiled, since a plan checks thousands of manoeuvres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ator_ros.bases.differential.durations import (
    Rates,
    direction,
    drive_parts,
    rates_of,
    turn_parts,
    turn_time,
)
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.turns import NODES, turn_end, write_headings
from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray, Pose, Record, record_type

_TOLERANCE = 1e-7
"""Distance in m within which the drive of a closed manoeuvre meets the last turn."""
_STEPS = 12
"""Steps of the secant method after which no manoeuvre is assumed to exist."""
_BACKWARD = -1e-6
"""Speed in m/s below which a robot drives backward."""
SPEED_PIECES = 13
"""Pieces of a manoeuvre's speed: three of each straight and two of each turn."""
TURN_PIECES = 9
"""Pieces of its turn rate: one of each straight and three of each turn."""


class Side(NamedTuple):
    """How one end of a manoeuvre is driven, seen from that end (at the goal: backward in time)."""

    length: float  # m; of the straight part at this end
    outer_speed: float  # m/s; at the start or goal
    speed: float  # m/s; between the straight part and the turn
    change: float  # m/s^2; constant change of speed in the turn, until the limit
    rate: float  # rad/s; greatest turn rate


SIDE = record_type([(name, float) for name in Side._fields])
"""A `Side` as a record, for compiled code and for arrays of candidates."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """The five phases between two poses in the world frame."""

    start: Pose
    goal: Pose
    entry: Side
    exit: Side
    first: float  # rad; signed angle of the first turn
    last: float  # rad; signed angle of the last turn
    distance: float  # m; straight drive between the turns, negative: backward
    limits: Limits

    @property
    def duration(self) -> float:
        """Planned time in s."""
        return float(self.pieces()[2])

    def pieces(self) -> tuple[FloatArray, FloatArray, float]:
        """Return the velocity and the turn rate over time, and the duration in s.

        See `write_pieces`.
        """
        speeds = np.empty((SPEED_PIECES, 3))
        turns = np.empty((TURN_PIECES, 3))
        entry, exit_ = np.array([self.entry, self.exit], dtype=SIDE)
        rates = rates_of(self.limits)
        duration = write_pieces(
            speeds,
            turns,
            self.first,
            self.last,
            self.distance,
            entry,
            exit_,
            rates,
        )
        return speeds, turns, duration


@compiled
def pose_after_turn(start: Pose, angle: float, side: Record, bounds: Rates) -> Pose:
    """Return the pose after the straight part and the turn by `angle` (rad) of a `SIDE`."""
    headings = np.empty((2, len(NODES)))
    time = write_headings(angle, side.rate, bounds.aw, headings)
    x, y = turn_end(time, headings, side.speed, side.change, bounds.v)
    x += side.length
    cos = math.cos(start.yaw)
    sin = math.sin(start.yaw)
    return Pose(start.x + cos * x - sin * y, start.y + sin * x + cos * y, start.yaw + angle)


@compiled
def _gap(
    first: float,
    last: float,
    start: Pose,
    goal: Pose,
    entry: Record,
    leaving: Record,
    bounds: Rates,
) -> tuple[float, float]:
    """Return the lateral error of the straight drive at the last turn, and its length, in m."""
    begin = pose_after_turn(start, first, entry, bounds)
    end = pose_after_turn(Pose(goal.x, goal.y, goal.yaw + math.pi), -last, leaving, bounds)
    dx = end.x - begin.x
    dy = end.y - begin.y
    c = math.cos(begin.yaw)
    s = math.sin(begin.yaw)
    return c * dy - s * dx, c * dx + s * dy


@compiled
def close(
    first: float,
    last: float,
    start: Pose,
    goal: Pose,
    entry: Record,
    leaving: Record,
    bounds: Rates,
) -> tuple[float, float, float, bool]:
    """Solve for the first turn of a manoeuvre to its goal, by the secant method from `first`.

    Returns both turns in rad, the drive in m, and whether the method converged.
    """
    total = first + last
    x0 = first
    x1 = first + 1e-4
    f0, distance = _gap(x0, total - x0, start, goal, entry, leaving, bounds)
    f1, distance = _gap(x1, total - x1, start, goal, entry, leaving, bounds)
    for _ in range(_STEPS):
        if abs(f1) < _TOLERANCE:
            return x1, total - x1, distance, True
        if f1 == f0:
            break
        change = min(max(-f1 * (x1 - x0) / (f1 - f0), -0.2), 0.2)
        x0 = x1
        f0 = f1
        x1 += change
        f1, distance = _gap(x1, total - x1, start, goal, entry, leaving, bounds)
    return x1, total - x1, distance, False


@compiled
def write_pieces(
    speeds: FloatArray,
    turns: FloatArray,
    first: float,
    last: float,
    distance: float,
    entry: Record,
    leaving: Record,
    bounds: Rates,
) -> float:
    """Write the velocities of a manoeuvre over time; return its duration in s.

    `speeds` (m/s) and `turns` (rad/s), shapes (SPEED_PIECES, 3) and (TURN_PIECES, 3), become linear
    pieces: duration in s, values at both ends. `entry` and `leaving` are `SIDE`s, see `Manoeuvre`.
    """
    ramp, held, v1 = _ramp(first, entry, bounds)
    _straight(speeds, 0, entry.length, entry.outer_speed, entry.speed, bounds)
    speeds[3] = ramp, entry.speed, v1
    speeds[4] = held, v1, v1
    ramp, held, v2 = _ramp(last, leaving, bounds)
    _straight(speeds, 5, distance, v1, v2, bounds)
    speeds[8] = held, v2, v2
    speeds[9] = ramp, v2, leaving.speed
    _straight(speeds, 10, leaving.length, leaving.speed, leaving.outer_speed, bounds)
    _turn(turns, 1, first, entry.rate, bounds.aw)
    _turn(turns, 5, last, leaving.rate, bounds.aw)
    for at in range(3):
        straight = speeds[5 * at, 0] + speeds[5 * at + 1, 0] + speeds[5 * at + 2, 0]
        turns[4 * at] = straight, 0.0, 0.0
    total = 0.0
    for piece in range(SPEED_PIECES):
        total += speeds[piece, 0]
    return total


@compiled
def is_forward(speeds: FloatArray, distance: float, bounds: Rates) -> bool:
    """Return whether no piece is backward, and the drive suffices for its change of speed."""
    for piece in range(SPEED_PIECES):
        if speeds[piece, 0] > 0.0 and speeds[piece, 2] < _BACKWARD:
            return False
    suffices: bool = direction(distance, speeds[4, 2], speeds[8, 1], bounds) > 0.0
    return suffices


@compiled
def _straight(
    pieces: FloatArray,
    at: int,
    distance: float,
    v1: float,
    v2: float,
    bounds: Rates,
) -> None:
    gaining, steady, losing, top = drive_parts(distance, v1, v2, bounds)
    pieces[at] = gaining, v1, top
    pieces[at + 1] = steady, top, top
    pieces[at + 2] = losing, top, v2


@compiled
def _ramp(angle: float, side: Record, bounds: Rates) -> tuple[float, float, float]:
    """Return how long the speed changes in a turn, and is constant, in s, and its final value."""
    total = turn_time(angle, side.rate, bounds.aw)
    ramp = total
    if side.change != 0.0:
        bound = math.copysign(bounds.v, side.change)
        ramp = min(total, max(0.0, (bound - side.speed) / side.change))
    return ramp, total - ramp, side.speed + side.change * ramp


@compiled
def _turn(turns: FloatArray, at: int, angle: float, rate: float, aw: float) -> None:
    ramp, steady = turn_parts(angle, rate, aw)
    peak = math.copysign(aw * ramp, angle)
    turns[at] = ramp, 0.0, peak
    turns[at + 1] = steady, peak, peak
    turns[at + 2] = ramp, peak, 0.0
