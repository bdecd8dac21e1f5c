"""Where turns lead that are driven at the limits while the speed changes: tables, made once per robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ator_ros.geometry import FloatArray
from ator_ros.robot import Limits

Indices = NDArray[np.intp]
RealArray = NDArray[np.floating[Any]]

STEP = np.pi / 8.0  # rad between the turns among which motions are bracketed
HALF = 12  # turns of up to 270 degrees either way
FINE = 36  # entries of the tables per step
SPEED_STEP = 0.02  # m/s
TURNS: FloatArray = STEP * np.arange(-HALF, HALF + 1, dtype=float)
WIDEST = (HALF + 0.99) * STEP  # up to which turns can be looked up
_EDGE = (HALF + 1) * FINE
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_NODES, _WEIGHTS = (_NODES + 1.0) / 2.0, _WEIGHTS / 2.0


class Way(NamedTuple):
    """How a turn is driven: change of speed in m/s^2, held at the limit, and greatest turn rate in rad/s."""

    change: float
    rate: float


@dataclass(frozen=True, eq=False)
class TurnTables:
    """Displacements of turns by angles from -292.5 to 292.5 degrees, for some ways to drive them.

    They are given along and across (to the left of) the heading that lies between the turn and the straight
    drive: there the parts of both turns of a motion just add.

    Attributes
    ----------
    along, across : ndarray, shape (rows * angles,)
        In m; a row for each way and speed.
    brackets : ndarray, shape (rows, len(TURNS))
        Across, at TURNS.
    windows : ndarray, shape (rows, FINE, windows, len(TURNS))
        Across, at TURNS moved by whole steps and fractions of one; see `window`.
    lowest : float
        First speed in m/s.
    speeds : int
        Number of speeds.
    """

    along: FloatArray
    across: FloatArray
    brackets: RealArray
    windows: RealArray
    lowest: float
    speeds: int

    def rows(self, way: Indices, speed: RealArray) -> Indices:
        """Give the rows of turns that are driven in `way` from `speed` (m/s)."""
        row = ((speed - self.lowest) * (1.0 / SPEED_STEP) + 0.5).astype(np.intp)
        result: Indices = way * self.speeds + row.clip(0, self.speeds - 1)
        return result

    def across_from(self, row: Indices, moved: RealArray) -> RealArray:
        """Give across at TURNS moved by `moved` (rad, within 540 degrees), shape (..., len(TURNS))."""
        step, fraction = np.divmod((2 * HALF * FINE + 0.5 + moved * (FINE / STEP)).astype(np.intp), FINE)
        return self.windows[row, fraction, step]

    def place(self, row: Indices, angle: FloatArray) -> tuple[Indices, FloatArray]:
        """Give where turns by `angle` (rad) lie in the tables: the entry before, and the share beyond it."""
        place = angle * (FINE / STEP) + _EDGE
        low = place.astype(np.intp)
        share = place - low
        return low + row * (2 * _EDGE + 1), share

    def at(self, table: FloatArray, place: tuple[Indices, FloatArray]) -> FloatArray:
        """Look up `along` or `across` at a place."""
        low, share = place
        below = table.take(low)
        result: FloatArray = below + share * (table.take(low + 1) - below)
        return result


@lru_cache(maxsize=32)
def turn_tables(limits: Limits, ways: tuple[Way, ...]) -> TurnTables:
    """Compute the tables of `ways` for a robot's limits; cached."""
    angles: FloatArray = np.linspace(0.0, (HALF + 1) * STEP, _EDGE + 1)
    speeds: FloatArray = np.arange(-limits.v, limits.v + SPEED_STEP / 2, SPEED_STEP, dtype=np.float64)
    parts = [_displacements(limits, way, speeds, angles) for way in ways]
    # A turn to the right is the mirror image of one to the left.
    along = np.concatenate([np.hstack((x[:, :0:-1], x)) for x, _ in parts])
    across = np.concatenate([np.hstack((-y[:, :0:-1], y)) for _, y in parts])
    # TURNS moved by up to 2 * HALF steps either way; what lies beyond the table is found, and then left out.
    beyond = (2 * HALF - 1) * FINE
    wide = np.pad(across[:, :-1], ((0, 0), (beyond, beyond + 2 * FINE)), mode="edge").astype(np.float32)
    fractions = np.ascontiguousarray(wide.reshape(len(wide), -1, FINE).swapaxes(1, 2))
    windows = np.lib.stride_tricks.sliding_window_view(fractions, len(TURNS), axis=-1)
    brackets = across[:, FINE:-FINE:FINE].astype(np.float32)
    return TurnTables(along.ravel(), across.ravel(), brackets, windows, -limits.v, len(speeds))


def _displacements(
    limits: Limits, way: Way, speeds: FloatArray, angles: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Give along and across, shapes (speeds, angles), of turns to the left in one way."""
    ramp = np.minimum(np.sqrt(angles / limits.aw), way.rate / limits.aw)
    time = 2.0 * ramp + np.maximum(angles - limits.aw * ramp * ramp, 0.0) / way.rate
    now, ramp = time[:, None] * _NODES, ramp[:, None]
    begin = np.minimum(now, ramp)
    end = np.minimum(time[:, None] - now, ramp)
    even = limits.aw * ramp * np.clip(now - ramp, 0.0, np.maximum(time[:, None] - 2.0 * ramp, 0.0))
    # Ramp up, even rate, ramp down: the last part is what the mirrored ramp still lacks.
    heading = 0.5 * limits.aw * (begin * begin + ramp * ramp - end * end) + even
    weight = _WEIGHTS * time[:, None]
    left = angles[:, None] - heading
    cos, sin = weight * np.cos(left), -weight * np.sin(left)
    along, across = (np.empty((len(speeds), len(angles))) for _ in range(2))
    for row, speed in enumerate(speeds):
        driven = np.clip(speed + way.change * now, -limits.v, limits.v)
        along[row], across[row] = (driven * cos).sum(axis=1), (driven * sin).sum(axis=1)
    return along, across
