"""Quantities of many situations in one pass: compiled, since dozens of short array operations take longer.

Angles of vectors are not computed here. numpy's arctan2 differs from the compiled one in the last digit, and
the shipped models were learned with numpy's.
"""

from __future__ import annotations

import math

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.performance.direct import HOLD, XG, YAW, YAWG, YG, V, W, X, Y


@compiled
def wrapped(angle: float) -> float:
    """Return the same angle in rad in [-pi, pi), as `ator_ros.geometry.wrap_angles` does."""
    turned = angle + math.pi
    if not 0.0 <= turned < 2.0 * math.pi:  # mostly it is: the remainder takes long and would change nothing
        turned %= 2.0 * math.pi
    return turned - math.pi


@compiled
def derive_ways(direct: FloatArray, hold: float, ways: FloatArray) -> None:
    """Write x and y of the destination, its dx, dy and dist from the start (m), and the turn to it (rad).

    Parameters
    ----------
    direct : ndarray, shape (10 or more, n)
        Direct variables, in the order of `DIRECT_VARIABLES`.
    hold : float
        Distance in m from the axle to what is held.
    ways : ndarray, shape (6, n)
        Result.
    """
    for at in range(direct.shape[1]):
        back, heading = hold * direct[HOLD, at], direct[YAWG, at]
        x = direct[XG, at] - back * math.cos(heading)
        y = direct[YG, at] - back * math.sin(heading)
        dx, dy = x - direct[X, at], y - direct[Y, at]
        ways[0, at], ways[1, at], ways[2, at], ways[3, at] = x, y, dx, dy
        ways[4, at] = math.sqrt(dx * dx + dy * dy)
        ways[5, at] = wrapped(heading - direct[YAW, at])


@compiled
def derive_angles(direct: FloatArray, bearing: FloatArray, angles: FloatArray) -> None:
    """Write the angles (rad) to and at destinations with a bearing (rad), and their side: shape (3, n)."""
    for at in range(direct.shape[1]):
        to = wrapped(bearing[at] - direct[YAW, at])
        angles[0, at], angles[1, at] = to, wrapped(direct[YAWG, at] - bearing[at])
        angles[2, at] = 1.0 if to >= 0.0 else -1.0


@compiled
def derive_openings(direct: FloatArray, aw: float, openings: FloatArray) -> None:
    """Write pose (m, m, rad) and time (s) at which the start's rotation is lost at up to `aw` (rad/s^2).

    The result has the shape (4, n).
    """
    for at in range(direct.shape[1]):
        time = abs(direct[W, at]) * (1.0 / aw)
        half = 0.5 * direct[W, at] * time
        heading = direct[YAW, at] + (2.0 / 3.0) * half  # in the mean
        way = direct[V, at] * time
        openings[0, at] = direct[X, at] + way * math.cos(heading)
        openings[1, at] = direct[Y, at] + way * math.sin(heading)
        openings[2, at], openings[3, at] = direct[YAW, at] + half, time


@compiled
def see_ends(
    openings: FloatArray,
    speeds: FloatArray,
    x: FloatArray,
    y: FloatArray,
    headings: FloatArray,
    arrivals: FloatArray,
    ends: FloatArray,
) -> None:
    """Write destinations as seen from the openings.

    Parameters
    ----------
    openings : ndarray, shape (4, n)
        See `derive_openings`.
    speeds : ndarray, shape (n,)
        There, in m/s.
    x, y, headings, arrivals : ndarray, shape (m, n)
        Destinations: m, m, rad, m/s.
    ends : ndarray, shape (5, m, n)
        Result, see `ator_ros.motion.ideal_times.fastest_motions`.
    """
    for at in range(openings.shape[1]):
        cos, sin = math.cos(openings[2, at]), math.sin(openings[2, at])
        for choice in range(len(x)):
            dx, dy = x[choice, at] - openings[0, at], y[choice, at] - openings[1, at]
            ends[0, choice, at] = cos * dx + sin * dy
            ends[1, choice, at] = cos * dy - sin * dx
            ends[2, choice, at] = wrapped(headings[choice, at] - openings[2, at])
            ends[3, choice, at], ends[4, choice, at] = speeds[at], arrivals[choice, at]
