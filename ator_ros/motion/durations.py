"""How long turns and straight drives take at a robot's limits: for numbers, and for arrays of one shape.

Features are computed with these, plans with `profiles` and, bit for bit the same, `compiled_manoeuvre`. The
two differ in the last digit for a third of all inputs: products with reciprocals here, divisions there. The
shipped models were learned with the one and their experience was driven with the other, so neither can
replace the other without learning everything anew.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.robot.description import Limits

Real = TypeVar("Real", float, FloatArray)


class Rates(NamedTuple):
    """Limits as plain numbers: m/s, rad/s, m/s^2 gaining and losing speed, rad/s^2; see `Limits`."""

    v: float
    w: float
    a: float
    brake: float
    aw: float


def rates_of(limits: Limits) -> Rates:
    """Return limits as plain numbers."""
    return Rates(limits.v, limits.w, limits.a, limits.brake, limits.aw)


@compiled
def turn_time(angle: Real, rate: float, aw: float) -> Real:
    """Return the time in s of turns by `angle` (rad, not negative) at up to `rate` (rad/s), rest to rest."""
    ramped = rate * rate * (1.0 / aw)
    short = 2.0 * np.sqrt(np.minimum(angle, ramped) * (1.0 / aw))
    result: Real = short + np.maximum(angle - ramped, 0.0) / rate
    return result


@compiled
def change_distance(before: Real, after: Real, rates: Rates) -> Real:
    """Return the signed distance in m in which the speed goes straight from `before` to `after` (m/s)."""
    gain = after - before
    time = np.maximum(gain * (1.0 / rates.a), gain * (-1.0 / rates.brake))
    result: Real = 0.5 * (before + after) * time
    return result


@compiled
def drive_time(distance: Real, before: Real, after: Real, rates: Rates) -> Real:
    """Return the time in s of straight drives over signed `distance` (m) between two speeds (m/s).

    Where the distance is too short for the change of speed, the motion overshoots and comes back.
    """
    surplus = distance - change_distance(before, after, rates)
    # What moves backward all the way is seen as a drive in that direction.
    least = 1e-9 * (2.0 * (np.maximum(before, after) < 0.0) - 1.0)
    sign = 2.0 * (surplus >= least) - 1.0
    result: Real = forward_time(sign * distance, sign * before, sign * after, rates)
    return result


@compiled
def forward_time(distance: Real, before: Real, after: Real, rates: Rates) -> Real:
    """Return the time in s of drives that gain speed first, or keep it, and lose it at the end."""
    up, down = rates.a, rates.brake
    square1, square2 = before * before, after * after
    square = (down * square1 + up * square2 + (2.0 * up * down) * distance) * (1.0 / (up + down))
    most = np.maximum(np.maximum(before, after), 0.0)
    square = np.minimum(np.maximum(square, most * most), rates.v * rates.v)
    peak = np.sqrt(square)
    cruise = distance - (square - square1) * (0.5 / up) - (square - square2) * (0.5 / down)
    ramps = (peak - before) * (1.0 / up) + (peak - after) * (1.0 / down)
    result: Real = ramps + np.maximum(cruise, 0.0) * (1.0 / rates.v)
    return result
