"""How long turns and straight drives take at a robot's limits, vectorised for features."""

from __future__ import annotations

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.robot import Limits


def turn_time(angle: FloatArray | float, rate: FloatArray | float, aw: float) -> FloatArray:
    """Give the time in s of turns by `angle` (rad, not negative) at up to `rate` (rad/s), rest to rest."""
    ramped = rate * rate * (1.0 / aw)
    short = 2.0 * np.sqrt(np.minimum(angle, ramped) * (1.0 / aw))
    return np.asarray(short + np.maximum(angle - ramped, 0.0) / rate)


def change_distance(before: FloatArray, after: FloatArray, limits: Limits) -> FloatArray:
    """Give the signed distance in m in which the speed goes straight from `before` to `after` (m/s)."""
    gain = after - before
    time = np.maximum(gain * (1.0 / limits.a), gain * (-1.0 / limits.brake))
    return np.asarray(0.5 * (before + after) * time)


def drive_time(distance: FloatArray, before: FloatArray, after: FloatArray, limits: Limits) -> FloatArray:
    """Give the time in s of straight drives over signed `distance` (m) between two speeds (m/s).

    Where the distance is too short for the change of speed, the motion overshoots and comes back.
    """
    surplus = distance - change_distance(before, after, limits)
    # What moves backward all the way is seen as a drive in that direction.
    sign = np.where(surplus >= np.where(np.maximum(before, after) < 0.0, 1e-9, -1e-9), 1.0, -1.0)
    return forward_time(sign * distance, sign * before, sign * after, limits)


def forward_time(distance: FloatArray, before: FloatArray, after: FloatArray, limits: Limits) -> FloatArray:
    """Give the time in s of drives that gain speed first, or keep it, and lose it at the end."""
    up, down = limits.a, limits.brake
    square1, square2 = before * before, after * after
    square = (down * square1 + up * square2 + (2.0 * up * down) * distance) * (1.0 / (up + down))
    most = np.maximum(np.maximum(before, after), 0.0)
    square = np.minimum(np.maximum(square, most * most), limits.v * limits.v)
    peak = np.sqrt(square)
    cruise = distance - (square - square1) * (0.5 / up) - (square - square2) * (0.5 / down)
    ramps = (peak - before) * (1.0 / up) + (peak - after) * (1.0 / down)
    return np.asarray(ramps + np.maximum(cruise, 0.0) * (1.0 / limits.v))
