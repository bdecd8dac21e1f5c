"""Displacements by turns during which the speed changes, and tables of them.

A turn by an angle starts and ends without rotation; meanwhile the speed changes by a constant
acceleration, up to the limit. Reversed in time, the same displacement is that of a turn at the end
of a motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ator_ros.bases.differential.durations import Bounds, turn_parts
from ator_ros.compiled import compiled, inlined
from ator_ros.geometry import FloatArray

STEP = np.pi / 8.0
"""Angle in rad between the turns that bracket the paths of features."""
HALF = 12
"""Such turns to either side: up to 270 degrees."""
FINE = 36
"""Entries of the tables per step."""
EDGE = (HALF + 1) * FINE
"""Entries of the tables either side of no turn: up to 292.5 degrees."""
ENTRIES = 2 * EDGE + 1
"""Entries of a row of the tables."""
WIDEST = (HALF + 0.99) * STEP
"""Greatest angle in rad that can be looked up."""
_PER_ANGLE = FINE / STEP  # entries per rad

_POINTS, _OVER_TWO = np.polynomial.legendre.leggauss(16)
NODES = (_POINTS + 1.0) / 2.0
WEIGHTS = _OVER_TWO / 2.0
"""Gauss-Legendre over [0, 1]; 16 nodes give the displacement of a full turn to 0.1 mm."""


@compiled
def write_headings(angle: float, rate: float, aw: float, headings: FloatArray) -> float:
    """Write cosine and sine of the heading at the nodes of a turn by `angle` (rad), shape (2, 16).

    Returns its time in s, at up to `rate` (rad/s) which changes by `aw` (rad/s^2).
    """
    size = abs(angle)
    side = math.copysign(1.0, angle)
    ramp, steady = turn_parts(size, rate, aw)
    whole = 2.0 * ramp + steady
    for node in range(len(NODES)):
        now = NODES[node] * whole
        rest = whole - now
        if now < ramp:
            turned = 0.5 * aw * now * now
        elif rest < ramp:
            turned = size - 0.5 * aw * rest * rest
        else:
            turned = aw * ramp * (now - 0.5 * ramp)
        headings[0, node] = math.cos(turned)
        headings[1, node] = side * math.sin(turned)
    return float(whole)


@inlined
def turn_end(
    time: float,
    headings: FloatArray,
    speed: float,
    acceleration: float,
    v: float,
) -> tuple[float, float]:
    """Return the displacement by a turn of `time` s, in m forward and left; see `write_headings`.

    It starts at `speed` (m/s), which changes by `acceleration` (m/s^2), up to the limit `v`.
    """
    x = y = 0.0
    for node in range(len(NODES)):
        step = min(max(speed + acceleration * (time * NODES[node]), -v), v) * WEIGHTS[node]
        x += step * headings[0, node]
        y += step * headings[1, node]
    return time * x, time * y


class TurnTable(NamedTuple):
    """Displacements by turns of -292.5 to 292.5 degrees in m, arrays of shape (rows * entries,).

    They are given along and across (to the left of) the heading of the straight drive: there the
    parts of both turns of a motion just add. `along` does not contain the initial speed times the
    duration of the turn, which grows with the root of a small angle and cannot be interpolated.
    """

    along: FloatArray
    across: FloatArray


def turn_table(turns: FloatArray, limits: Bounds) -> TurnTable:
    """Compute the table of `turns`, shape (rows, 3), within limits of speed and turn acceleration.

    A row holds the initial speed (m/s), its constant change (m/s^2) and the greatest turn rate
    (rad/s).
    """
    along, across = np.empty((2, len(turns), ENTRIES))
    _write_table(np.ascontiguousarray(turns, dtype=float), limits.v, limits.aw, along, across)
    return TurnTable(along.ravel(), across.ravel())


@compiled
def _write_table(
    turns: FloatArray,
    v: float,
    aw: float,
    along: FloatArray,
    across: FloatArray,
) -> None:
    headings = np.empty((2, len(NODES)))
    for entry in range(EDGE + 1):
        angle = entry / _PER_ANGLE
        rate = math.nan
        time = 0.0
        c = math.cos(angle)
        s = math.sin(angle)
        for row in range(len(turns)):
            if turns[row, 2] != rate:  # often it is that of the row before
                rate = turns[row, 2]
                time = write_headings(angle, rate, aw, headings)
            x, y = turn_end(time, headings, turns[row, 0], turns[row, 1], v)
            # A turn to the right is the mirror image of one to the left.
            beyond = c * x + s * y - turns[row, 0] * time
            along[row, EDGE + entry] = along[row, EDGE - entry] = beyond
            across[row, EDGE + entry] = c * y - s * x
            across[row, EDGE - entry] = s * x - c * y


@inlined
def look_up(column: FloatArray, row: int, angle: float) -> float:
    """Look up a turn by `angle` (rad) in a row of a column of a `TurnTable`."""
    place = angle * _PER_ANGLE + EDGE
    low = int(place)
    at = low + row * ENTRIES
    result: float = column[at] + (place - low) * (column[at + 1] - column[at])
    return result
