"""Turns driven while the speed changes: where the robot ends up.

A turn by an angle starts and ends without rotation; meanwhile the speed changes by a constant acceleration,
up to the limit. The same displacement, taken backward in time, belongs to a turn that ends a motion.
"""

from __future__ import annotations

import itertools
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.planned.profiles import turn_progress, turn_times
from ator_ros.geometry import FloatArray
from ator_ros.robot import Limits

_POINTS, _OVER_TWO = np.polynomial.legendre.leggauss(16)
NODES, WEIGHTS = (_POINTS + 1.0) / 2.0, _OVER_TWO / 2.0
"""Gauss-Legendre over [0, 1]; 16 nodes give the displacement of a full turn to 0.1 mm."""


class Driving(NamedTuple):
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


def displacements(angles: FloatArray, driving: Driving, limits: Limits) -> FloatArray:
    """Return where turns by `angles` end, seen from where they start.

    Parameters
    ----------
    angles : ndarray, shape (n,)
        Signed angles in rad.
    driving : Driving
        How the turns are driven: numbers, or arrays of shape (n, 1) where each turn is driven in its own way.
    limits : Limits
        Greatest speed and turn acceleration.

    Returns
    -------
    ndarray, shape (2, n)
        Forward and leftward displacement in m in the frame of the start.
    """
    times = turn_times(angles[:, None], driving.turn_rate, limits.aw)
    headings = angles[:, None] * turn_progress(NODES, angles, driving.turn_rate, limits.aw)
    speed = speeds_after(driving.speed, driving.acceleration, times * NODES, limits.v)
    weighted = speed * WEIGHTS * times
    return np.stack(((weighted * np.cos(headings)).sum(axis=1), (weighted * np.sin(headings)).sum(axis=1)))


@lru_cache(maxsize=256)
def _table(angles: bytes, ways: tuple[Driving, ...], limits: Limits) -> FloatArray:
    grid = np.frombuffer(angles)
    table = np.stack([displacements(grid, driving, limits) for driving in ways])
    table.setflags(write=False)
    return table


def displacement_table(angles: FloatArray, ways: tuple[Driving, ...], limits: Limits) -> FloatArray:
    """Compute `displacements` for several ways to drive, shape (ways, 2, n); cached.

    Ways of one speed are kept together: of a start in motion, whose speed is new, only those are computed.
    """
    groups = itertools.groupby(ways, key=lambda way: way.speed)
    grid = angles.tobytes()
    return np.concatenate([_table(grid, tuple(group), limits) for _, group in groups])
