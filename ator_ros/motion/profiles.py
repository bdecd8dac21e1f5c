"""Time-optimal velocity profiles of one degree of freedom with bounded speed and acceleration."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.robot.description import Limits


class Piece(NamedTuple):
    """A stretch of time (s) in which a velocity changes linearly from `start` to `end`."""

    duration: float
    start: float
    end: float


def turn_times(angles: Any, w: Any, aw: float) -> FloatArray:
    """Return the least times in s to turn by `angles` (rad, any shape) from rest to rest.

    Parameters
    ----------
    angles : array_like
        Signed angles in rad.
    w : array_like
        Greatest turn rates in rad/s.
    aw : float
        Greatest turn acceleration in rad/s^2.
    """
    size = np.abs(angles)
    return np.asarray(np.where(size <= w * w / aw, 2.0 * np.sqrt(size / aw), size / w + w / aw))


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
    times = turn_times(size, w, aw)
    peak = np.minimum(w, np.sqrt(size * aw))
    ramp = peak / aw
    t = fractions * times
    rest = times - t
    done = np.where(
        t < ramp,
        0.5 * aw * t * t,
        np.where(rest < ramp, size - 0.5 * aw * rest * rest, peak * (t - 0.5 * ramp)),
    )
    return np.asarray(done / size)


def turn_pieces(angle: float, w: float, aw: float) -> list[Piece]:
    """Return the turn rate over time of the fastest turn by `angle` (rad) from rest to rest."""
    peak = min(w, float(np.sqrt(abs(angle) * aw)))
    if peak <= 0.0:
        return []
    cruise = max(0.0, abs(angle) / peak - peak / aw)
    peak, ramp = float(np.copysign(peak, angle)), peak / aw
    return [Piece(ramp, 0.0, peak), Piece(cruise, peak, peak), Piece(ramp, peak, 0.0)]


def speed_change_distances(v1: Any, v2: Any, limits: Limits) -> FloatArray:
    """Return the signed distances in m covered while the speed goes straight from v1 to v2 (m/s)."""
    rate = np.where(np.asarray(v2) >= v1, limits.a, limits.brake)
    return np.asarray((v1 + v2) * np.abs(np.subtract(v2, v1)) / (2.0 * rate))


def straight_times(distances: Any, v1: Any, v2: Any, limits: Limits) -> FloatArray:
    """Return the least times in s to drive signed `distances` (m), from speed v1 to speed v2 (m/s).

    All arguments broadcast. Where the distance is too short for the change of speed, the motion
    overshoots and comes back, as the time-optimal motion does.
    """
    _, u1, u2, peak, cruise = _straight(distances, v1, v2, limits)
    return np.asarray((peak - u1) / limits.a + (peak - u2) / limits.brake + cruise)


def straight_pieces(distance: float, v1: float, v2: float, limits: Limits) -> list[Piece]:
    """Return the velocity over time of the fastest drive by `distance`; see `straight_times`."""
    gaining, steady, losing, top = map(float, straight_pieces_of(distance, v1, v2, limits))
    return [Piece(gaining, v1, top), Piece(steady, top, top), Piece(losing, top, v2)]


def straight_pieces_of(
    distances: Any, v1: Any, v2: Any, limits: Limits
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute how long fastest drives gain speed, hold it and lose it, in s, and that speed in m/s.

    All arguments broadcast; see `straight_times`.
    """
    sign, u1, u2, peak, cruise = _straight(distances, v1, v2, limits)
    return (peak - u1) / limits.a, cruise, (peak - u2) / limits.brake, sign * peak


def _straight(distances: Any, v1: Any, v2: Any, limits: Limits) -> tuple[Any, Any, Any, Any, Any]:
    """Return direction, both speeds and the peak in that direction, and the time at the peak."""
    up, down = limits.a, limits.brake
    # A stretch made to measure for its change of speed must not count as a hair too short; and what moves
    # backward all the way is seen as a drive in that direction.
    surplus = np.asarray(distances) - speed_change_distances(v1, v2, limits)
    backward = np.maximum(v1, v2) < 0.0
    sign = np.where(surplus >= np.where(backward, 1e-9, -1e-9), 1.0, -1.0)
    d, u1, u2 = sign * distances, sign * v1, sign * v2
    squares = (down * u1 * u1 + up * u2 * u2 + 2.0 * up * down * d) / (up + down)
    free = np.sqrt(np.maximum(squares, np.maximum(u1, u2) ** 2 * (np.maximum(u1, u2) > 0.0)))
    peak = np.minimum(free, limits.v)
    ramps = (peak * peak - u1 * u1) / (2.0 * up) + (peak * peak - u2 * u2) / (2.0 * down)
    return sign, u1, u2, peak, np.maximum(d - ramps, 0.0) / limits.v
