"""The fastest way to drive a planned motion where the base is weaker than it was planned for.

The path stays; its time passes at another rate, so that no acceleration asks for more than the limits. The
greatest rates come from a pass backward and a pass forward (Pham and Pham, TOPP-RA, T-RO 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.robot.description import Limits

_HALVINGS = 20


@dataclass(frozen=True, slots=True)
class _Bound:
    """An acceleration in a stretch: `before` and `after` times the squared rates, from `least` to `most`."""

    before: float
    after: float
    least: float
    most: float

    def span(self, square: float) -> tuple[float, float]:
        """Return from where to where the squared rate after the stretch may be, given the one before."""
        rest = self.before * square
        if self.after == 0.0:
            return (0.0, math.inf) if self.least <= rest <= self.most else (math.inf, 0.0)
        ends = (self.least - rest) / self.after, (self.most - rest) / self.after
        return min(ends), max(ends)


_Stretch = tuple[_Bound, ...]


def greatest_rates(v: FloatArray, w: FloatArray, steps: FloatArray, limits: Limits) -> FloatArray:
    """Return how fast the time of a motion may pass at each of n moments, from 0 to 1.

    Parameters
    ----------
    v, w : ndarray, shape (n,)
        Planned velocities in m/s and rad/s, which change linearly between the moments.
    steps : ndarray, shape (n - 1,)
        Planned times in s between the moments.
    limits : Limits
        Accelerations that the base has.
    """
    stretches = [
        (*_driving(*drives, step, limits), *_bounds(*turns, step, -limits.aw, limits.aw))
        for drives, turns, step in zip(
            pairwise(v.tolist()), pairwise(w.tolist()), steps.tolist(), strict=True
        )
    ]
    most = [1.0]
    for stretch in reversed(stretches):
        most.append(_most_before(stretch, most[-1]))
    most.reverse()
    squares = most[:1]
    for stretch, bound in zip(stretches, most[1:], strict=True):
        squares.append(max(0.0, min(bound, _span(stretch, squares[-1])[1])))
    return np.sqrt(squares)


def _driving(start: float, end: float, step: float, limits: Limits) -> _Stretch:
    forward = start + end >= 0.0
    least, most = (-limits.brake, limits.a) if forward else (-limits.a, limits.brake)
    return _bounds(start, end, step, least, most)


def _bounds(start: float, end: float, step: float, least: float, most: float) -> _Stretch:
    """Bound the acceleration at both ends of a stretch in which a velocity goes from `start` to `end`."""
    # It is the squared rate times what is planned, and half of its change in time times the velocity.
    planned = (end - start) / step
    first, last = 0.5 * start / step, 0.5 * end / step
    return _Bound(planned - first, first, least, most), _Bound(-last, planned + last, least, most)


def _most_before(stretch: _Stretch, after: float) -> float:
    """Return the greatest squared rate from which one of up to `after` can follow."""
    low, high = 0.0, 1.0
    if _leads_to(stretch, high, after):
        return high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _leads_to(stretch, middle, after) else (low, middle)
    return low


def _leads_to(stretch: _Stretch, square: float, after: float) -> bool:
    least, most = _span(stretch, square)
    return max(0.0, least) <= min(after, most)


def _span(stretch: _Stretch, square: float) -> tuple[float, float]:
    """Return from where to where the squared rate after a stretch may be by all bounds."""
    spans = [bound.span(square) for bound in stretch]
    return max(least for least, _ in spans), min(most for _, most in spans)
