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
"""Searches are in single precision: far finer than the tables, and half the time of double."""

ANGLE_STEP = 0.01  # rad; entries are looked up, not interpolated: half a step is 2 mm or 2 ms
SPEED_STEP = 0.02  # m/s
LARGEST = 9.5  # rad either way: a full turn and what a search for the right one adds
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_NODES, _WEIGHTS = (_NODES + 1.0) / 2.0, _WEIGHTS / 2.0


class Way(NamedTuple):
    """How a turn is driven: change of speed in m/s^2, held at the limit, and greatest turn rate in rad/s."""

    change: float
    rate: float


@dataclass(frozen=True, eq=False)
class TurnTables:
    """Displacements and durations of turns by angles from -9.5 to 9.5 rad, for some ways to drive them.

    Attributes
    ----------
    ahead, left : ndarray, shape (ways * speeds * angles,)
        Where the turn ends in m, seen from where it begins.
    time : ndarray, shape (ways * angles,)
        Duration in s.
    speeds, angles : int
        Sizes of the tables.
    lowest : float
        First speed in m/s.
    """

    ahead: RealArray
    left: RealArray
    time: RealArray
    speeds: int
    angles: int
    lowest: float

    def rows(self, way: Indices, speed: RealArray) -> Indices:
        """Give where the angles of turns begin that are driven in `way` from `speed` (m/s)."""
        row = ((speed - self.lowest) * (1.0 / SPEED_STEP) + 0.5).astype(np.intp)
        result: Indices = (way * self.speeds + row.clip(0, self.speeds - 1)) * self.angles
        return result

    def columns(self, angle: RealArray) -> Indices:
        """Give where turns by `angle` (rad) are within a row."""
        return (angle * (1.0 / ANGLE_STEP) + (LARGEST / ANGLE_STEP + 0.5)).astype(np.intp)


@lru_cache(maxsize=32)
def turn_tables(limits: Limits, ways: tuple[Way, ...]) -> TurnTables:
    """Compute the tables of `ways` for a robot's limits; cached."""
    angles = np.arange(0.0, LARGEST + ANGLE_STEP / 2, ANGLE_STEP)
    speeds = np.arange(-limits.v, limits.v + SPEED_STEP / 2, SPEED_STEP)
    parts = [_displacements(limits, way, speeds, angles) for way in ways]
    # A turn to the right is the mirror image of one to the left.
    ahead = np.concatenate([np.hstack((x[:, :0:-1], x)).ravel() for x, _, _ in parts])
    left = np.concatenate([np.hstack((-y[:, :0:-1], y)).ravel() for _, y, _ in parts])
    time = np.concatenate([np.hstack((t[:0:-1], t)) for _, _, t in parts])
    ahead, left, time = (table.astype(np.float32) for table in (ahead, left, time))
    return TurnTables(ahead, left, time, len(speeds), 2 * len(angles) - 1, -limits.v)


def _displacements(
    limits: Limits, way: Way, speeds: FloatArray, angles: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Give ahead and left, shape (speeds, angles), and the duration, shape (angles,), of turns in one way."""
    ramp = np.minimum(np.sqrt(angles / limits.aw), way.rate / limits.aw)
    time = 2.0 * ramp + np.maximum(angles - limits.aw * ramp * ramp, 0.0) / way.rate
    now, ramp = time[:, None] * _NODES, ramp[:, None]
    begin = np.minimum(now, ramp)
    end = np.minimum(time[:, None] - now, ramp)
    even = limits.aw * ramp * np.clip(now - ramp, 0.0, np.maximum(time[:, None] - 2.0 * ramp, 0.0))
    # Ramp up, even rate, ramp down: the last part is what the mirrored ramp still lacks.
    heading = 0.5 * limits.aw * (begin * begin + ramp * ramp - end * end) + even
    weight = _WEIGHTS * time[:, None]
    cos, sin = weight * np.cos(heading), weight * np.sin(heading)
    ahead, left = (np.empty((len(speeds), len(angles))) for _ in range(2))
    for row, speed in enumerate(speeds):
        driven = np.clip(speed + way.change * now, -limits.v, limits.v)
        ahead[row], left[row] = (driven * cos).sum(axis=1), (driven * sin).sum(axis=1)
    return ahead, left, time
