"""Time-optimal velocity profiles of one degree of freedom with bounded speed and acceleration."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import drive_parts, turn_parts
from ator_ros.robot.description import Limits


class Piece(NamedTuple):
    """A stretch of time (s) in which a velocity changes linearly from `start` to `end`."""

    duration: float
    start: float
    end: float


def turn_progress(fractions: FloatArray, angles: FloatArray, w: Any, aw: float) -> FloatArray:
    """Return the share of each turn that is done after each fraction of its time.

    Parameters
    ----------
    fractions : ndarray, shape (q,)
        Fractions of the turn's duration in [0, 1].
    angles : ndarray, shape (n,)
        Signed angles in rad.
    w : float or ndarray of shape (n, 1)
        Greatest turn rates in rad/s.
    aw : float
        Greatest turn acceleration in rad/s^2.

    Returns
    -------
    ndarray, shape (n, q)
        Shares in [0, 1], from rest to rest.
    """
    size = np.maximum(np.abs(angles), 1e-12)[:, None]
    ramp, steady = turn_parts(size, w, aw)
    t = fractions * (2.0 * ramp + steady)
    rest = 2.0 * ramp + steady - t
    done = np.where(
        t < ramp,
        0.5 * aw * t * t,
        np.where(rest < ramp, size - 0.5 * aw * rest * rest, aw * ramp * (t - 0.5 * ramp)),
    )
    return np.asarray(done / size)


def turn_pieces(angle: float, w: float, aw: float) -> list[Piece]:
    """Return the turn rate over time of the fastest turn by `angle` (rad) from rest to rest."""
    ramp, steady = map(float, turn_parts(angle, w, aw))
    peak = math.copysign(aw * ramp, angle)
    return [Piece(ramp, 0.0, peak), Piece(steady, peak, peak), Piece(ramp, peak, 0.0)]


def straight_pieces(distance: float, v1: float, v2: float, limits: Limits) -> list[Piece]:
    """Return the velocity over time of the fastest drive by signed `distance` (m) between speeds (m/s)."""
    gaining, steady, losing, top = map(float, drive_parts(distance, v1, v2, limits))
    return [Piece(gaining, v1, top), Piece(steady, top, top), Piece(losing, top, v2)]
