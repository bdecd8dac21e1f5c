"""Durations of turns and straight drives within limits.

Elementwise functions take numbers, or arrays that broadcast; results have the type `Real` of the
first one. They multiply by reciprocals, which compiled loops compute once: the search for paths
dominates refinement.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from ator_ros.bases.differential.limits import Limits
from ator_ros.compiled import elementwise, greatest, least, where
from ator_ros.geometry import FloatArray

Real = TypeVar("Real", float, FloatArray)


class Rates(NamedTuple):
    """Limits as plain numbers: m/s, rad/s, m/s^2 gaining and losing speed, rad/s^2.

    See `Limits`.
    """

    v: float
    w: float
    a: float
    brake: float
    aw: float


Bounds: TypeAlias = Rates | Limits
"""Compiled code takes `Rates` only."""


def rates_of(limits: Limits) -> Rates:
    """Return limits as plain numbers."""
    return Rates(
        *(float(value) for value in (limits.v, limits.w, limits.a, limits.brake, limits.aw))
    )


@elementwise
def turn_parts(angle: Real, rate: Any, aw: float) -> tuple[Real, Real]:
    """Return how long (s) the fastest turn by `angle` (rad), rest to rest, gains, holds its rate.

    `rate` (rad/s) is the greatest turn rate, `aw` (rad/s^2) its change when it is gained and when
    it is lost.
    """
    size: Any = np.abs(angle)
    ramped = rate * rate * (1.0 / aw)
    gaining = np.sqrt(least(size, ramped) * (1.0 / aw))
    return gaining, greatest(size - ramped, 0.0) / rate


@elementwise
def turn_time(angle: Real, rate: Any, aw: float) -> Real:
    """Return the time in s of turns by `angle` (rad) at up to `rate` (rad/s), rest to rest."""
    gaining, steady = turn_parts(angle, rate, aw)
    result: Real = 2.0 * gaining + steady
    return result


@elementwise
def change_time(before: Real, after: Any, rates: Bounds) -> Real:
    """Return the least time in s for a change of speed from `before` to `after` (m/s)."""
    per_a = 1.0 / rates.a
    per_brake = 1.0 / rates.brake
    gain = np.abs(after) - np.abs(before)
    # If the sign of the speed changes, the base brakes and accelerates at the lower of both rates.
    reverses = where(before * after < 0.0, np.abs(after - before), 0.0)
    result: Real = greatest(
        greatest(gain * per_a, gain * -per_brake), reverses * max(per_a, per_brake)
    )
    return result


@elementwise
def change_distance(before: Real, after: Any, rates: Bounds) -> Real:
    """Return the signed distance in m of the fastest change from `before` to `after` (m/s)."""
    result: Real = 0.5 * (before + after) * change_time(before, after, rates)
    return result


@elementwise
def direction(distance: Real, before: Any, after: Any, rates: Bounds) -> Real:
    """Return 1 where the fastest drive over signed `distance` (m) goes forward, -1 where backward.

    Where the distance is too short for the change of speed, the motion overshoots and comes back.
    """
    surplus = distance - change_distance(before, after, rates)
    # A drive that is backward from start to end counts as one in that direction. A drive exactly as
    # long as its change of speed needs must not count as too short.
    enough = where(greatest(before, after) < 0.0, 1e-9, -1e-9)
    result: Real = where(surplus >= enough, 1.0, -1.0)
    return result


@elementwise
def drive_time(distance: Real, before: Any, after: Any, rates: Bounds) -> Real:
    """Return the time in s of straight drives over signed `distance` (m) between speeds in m/s."""
    gaining, steady, losing, _ = drive_parts(distance, before, after, rates)
    result: Real = gaining + losing + steady
    return result


@elementwise
def drive_parts(
    distance: Real,
    before: Any,
    after: Any,
    rates: Bounds,
) -> tuple[Real, Real, Real, Real]:
    """Return how long drives gain speed, hold it and lose it, in s, and the speed held in m/s."""
    sign = direction(distance, before, after, rates)
    gaining, steady, losing, peak = forward_parts(
        sign * distance,
        sign * before,
        sign * after,
        rates,
    )
    return gaining, steady, losing, sign * peak


@elementwise
def forward_parts(
    distance: Real,
    before: Any,
    after: Any,
    rates: Bounds,
) -> tuple[Real, Real, Real, Real]:
    """Return `drive_parts` of drives that first accelerate, or keep their speed, and then brake.

    If the speed is negative at an end, it changes there at the lower of both accelerations, as it
    is both lost and gained in the other direction.
    """
    a = rates.a
    brake = rates.brake
    slow = min(rates.a, rates.brake)
    reverse1 = before < 0.0
    reverse2 = after < 0.0
    up = where(reverse1, slow, a)
    down = where(reverse2, slow, brake)
    # Choosing reciprocals is faster than dividing.
    per_up = where(reverse1, 1.0 / slow, 1.0 / a)
    per_down = where(reverse2, 1.0 / slow, 1.0 / brake)
    per_both = where(
        reverse1,
        where(reverse2, 1.0 / (slow + slow), 1.0 / (slow + brake)),
        where(reverse2, 1.0 / (a + slow), 1.0 / (a + brake)),
    )
    square1 = before * before
    square2 = after * after
    square = (down * square1 + up * square2 + (2.0 * up * down) * distance) * per_both
    most = greatest(greatest(before, after), 0.0)
    square = least(greatest(square, most * most), rates.v * rates.v)
    peak = np.sqrt(square)
    cruise = distance - (square - square1) * (0.5 * per_up) - (square - square2) * (0.5 * per_down)
    steady = greatest(cruise, 0.0) * (1.0 / rates.v)
    return (peak - before) * per_up, steady, (peak - after) * per_down, peak
