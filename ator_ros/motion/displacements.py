"""Turns driven while the speed changes: where the robot ends up.

A turn by an angle starts and ends without rotation; meanwhile the speed changes by a constant acceleration,
up to the limit. The same displacement, taken backward in time, belongs to a turn that ends a motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import turn_parts, turn_time
from ator_ros.robot.description import Limits

_POINTS, _OVER_TWO = np.polynomial.legendre.leggauss(16)
NODES, WEIGHTS = (_POINTS + 1.0) / 2.0, _OVER_TWO / 2.0
"""Gauss-Legendre over [0, 1]; 16 nodes give the displacement of a full turn to 0.1 mm."""


class TurnDriving(NamedTuple):
    """How a turn is driven.

    Attributes
    ----------
    speed : float
        Speed at the start of the turn in m/s.
    acceleration : float
        Constant acceleration during the turn in m/s^2.
    turn_rate : float
        Greatest turn rate in rad/s.
    """

    speed: float
    acceleration: float
    turn_rate: float


def speeds_after(start: Any, acceleration: Any, times: FloatArray, v: float) -> FloatArray:
    """Return the speeds (m/s) after `times` of constant acceleration, held at the limit `v`."""
    return np.asarray(np.clip(start + acceleration * times, -v, v))


def displacement_table(angles: FloatArray, ways: Sequence[TurnDriving], limits: Limits) -> FloatArray:
    """Return where turns end, seen from where they start; cached, as few are new.

    Parameters
    ----------
    angles : ndarray, shape (n,)
        Signed angles in rad.
    ways : sequence of TurnDriving
        How the turns are driven.
    limits : Limits
        Greatest speed and turn acceleration.

    Returns
    -------
    ndarray, shape (ways, 2, n)
        Forward and leftward displacement in m in the frame of the start.
    """
    grid = angles.tobytes()
    return np.stack([_on_grid(grid, way, limits) for way in ways])


class Headings(NamedTuple):
    """What the turn rate decides: times in s, (n, 1), those of the nodes, cosine and sine, (n, 16)."""

    times: FloatArray
    nodes: FloatArray
    cosines: FloatArray
    sines: FloatArray


def headings_of(angles: FloatArray, turn_rate: float, aw: float) -> Headings:
    """Return the headings during turns by `angles` (rad), shape (n,), from rest to rest."""
    times = turn_time(angles[:, None], turn_rate, aw)
    size = np.maximum(np.abs(angles), 1e-12)[:, None]
    ramp, steady = turn_parts(size, turn_rate, aw)
    now = NODES * (2.0 * ramp + steady)
    rest = 2.0 * ramp + steady - now
    done = np.where(
        now < ramp,
        0.5 * aw * now * now,
        np.where(rest < ramp, size - 0.5 * aw * rest * rest, aw * ramp * (now - 0.5 * ramp)),
    )
    headings = angles[:, None] * (done / size)
    return Headings(times, times * NODES, np.cos(headings), np.sin(headings))


def displacements(turns: Headings, speed: float, acceleration: float, v: float) -> FloatArray:
    """Return where turns end that begin at a speed (m/s) and change it (m/s^2) up to `v`, (2, n), in m."""
    weighted = speeds_after(speed, acceleration, turns.nodes, v) * WEIGHTS * turns.times
    return np.stack(((weighted * turns.cosines).sum(axis=-1), (weighted * turns.sines).sum(axis=-1)))


@lru_cache(maxsize=2048)
def _on_grid(angles: bytes, driving: TurnDriving, limits: Limits) -> FloatArray:
    turns = _headings_on_grid(angles, driving.turn_rate, limits.aw)
    return displacements(turns, driving.speed, driving.acceleration, limits.v)


@lru_cache(maxsize=128)
def _headings_on_grid(angles: bytes, turn_rate: float, aw: float) -> Headings:
    return headings_of(np.frombuffer(angles), turn_rate, aw)
