"""Quantities of many situations in one pass: compiled, since dozens of short array operations take longer.

Angles of vectors are not computed here. numpy's arctan2 differs from the compiled one in the last digit, and
the shipped models were learned with numpy's.
"""

from __future__ import annotations

import math

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.performance.direct import HOLD, SPEEDG, XG, YAW, YAWG, YG, V, W, X, Y

BASICS = (
    *("x", "y", "yaw", "xg", "yg", "yawg", "dx", "dy", "dist", "angle_to_dest", "angle_at_dest"),
    *("angle_at_dest_by_turn", "angle_between", "v", "w_by_turn", "speedg", "hold"),
)
"""Names of the features that the first rows hold, see `ator_ros.performance.features`."""
FROM_X, FROM_Y, FROM_YAW, GOAL_X, GOAL_Y, GOAL_YAW, DX, DY, DIST, ANGLE_TO, ANGLE_AT = range(11)
AT_BY_TURN, ANGLE_BETWEEN, SPEED, W_BY_TURN, ARRIVAL, HOLDS = range(11, len(BASICS))
TO_X, TO_Y, TO_DEST, AT_DEST, OPENING = range(len(BASICS), len(BASICS) + 5)
"""Rows after them: the destination (m), the signed angles to and at it (rad), and four of the opening: x, y
(m), heading (rad), and the time until then (s)."""
ROWS = OPENING + 4


@compiled
def wrapped(angle: float) -> float:
    """Return the same angle in rad in [-pi, pi), as `ator_ros.geometry.wrap_angles` does."""
    turned = angle + math.pi
    if not 0.0 <= turned < 2.0 * math.pi:  # mostly it is: the remainder takes long and would change nothing
        turned %= 2.0 * math.pi
    return turned - math.pi


@compiled
def derive_ways(direct: FloatArray, hold: float, aw: float, rows: FloatArray) -> None:
    """Write all rows but those of the bearing, see `derive_angles`.

    In the opening the start's rotation is lost at up to `aw`, while the speed stays what it is.

    Parameters
    ----------
    direct : ndarray, shape (10 or more, n)
        Direct variables, in the order of `DIRECT_VARIABLES`.
    hold : float
        Distance in m from the axle to what is held.
    aw : float
        Limit of the angular acceleration in rad/s^2.
    rows : ndarray, shape (ROWS or more, n)
        Result.
    """
    for at in range(direct.shape[1]):
        speed, rotation, yaw = direct[V, at], direct[W, at], direct[YAW, at]
        from_x, from_y, heading = direct[X, at], direct[Y, at], direct[YAWG, at]
        rows[FROM_X, at], rows[FROM_Y, at], rows[FROM_YAW, at] = from_x, from_y, yaw
        rows[GOAL_X, at], rows[GOAL_Y, at], rows[GOAL_YAW, at] = direct[XG, at], direct[YG, at], heading
        back = hold * direct[HOLD, at]
        x = direct[XG, at] - back * math.cos(heading)
        y = direct[YG, at] - back * math.sin(heading)
        dx, dy = x - from_x, y - from_y
        rows[TO_X, at], rows[TO_Y, at], rows[DX, at], rows[DY, at] = x, y, dx, dy
        rows[DIST, at] = math.sqrt(dx * dx + dy * dy)
        rows[ANGLE_BETWEEN, at] = abs(wrapped(heading - yaw))
        rows[SPEED, at], rows[ARRIVAL, at], rows[HOLDS, at] = speed, direct[SPEEDG, at], direct[HOLD, at]
        time = abs(rotation) * (1.0 / aw)
        half = 0.5 * rotation * time
        mean = yaw + (2.0 / 3.0) * half
        way = speed * time
        rows[OPENING, at] = from_x + way * math.cos(mean)
        rows[OPENING + 1, at] = from_y + way * math.sin(mean)
        rows[OPENING + 2, at], rows[OPENING + 3, at] = yaw + half, time


@compiled
def derive_angles(direct: FloatArray, bearing: FloatArray, rows: FloatArray) -> None:
    """Write the rows that need the bearing of the destination.

    Parameters
    ----------
    direct : ndarray, shape (10 or more, n)
        As for `derive_ways`.
    bearing : ndarray, shape (n,)
        Of the way in the rows DX and DY, in rad.
    rows : ndarray, shape (ROWS or more, n)
        Result.
    """
    for at in range(direct.shape[1]):
        to = wrapped(bearing[at] - direct[YAW, at])
        there = wrapped(direct[YAWG, at] - bearing[at])
        side = 1.0 if to >= 0.0 else -1.0
        rows[TO_DEST, at], rows[AT_DEST, at] = to, there
        rows[ANGLE_TO, at], rows[ANGLE_AT, at] = abs(to), abs(there)
        rows[AT_BY_TURN, at], rows[W_BY_TURN, at] = side * there, side * direct[W, at]


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
        Rows OPENING to OPENING + 3.
    speeds : ndarray, shape (n,)
        There, in m/s.
    x, y, headings, arrivals : ndarray, shape (m, n)
        Destinations: m, m, rad, m/s.
    ends : ndarray, shape (5, m, n)
        Result, see `ator_ros.motion.families.fastest_motions`.
    """
    for at in range(openings.shape[1]):
        cos, sin = math.cos(openings[2, at]), math.sin(openings[2, at])
        for choice in range(len(x)):
            dx, dy = x[choice, at] - openings[0, at], y[choice, at] - openings[1, at]
            ends[0, choice, at] = cos * dx + sin * dy
            ends[1, choice, at] = cos * dy - sin * dx
            ends[2, choice, at] = wrapped(headings[choice, at] - openings[2, at])
            ends[3, choice, at], ends[4, choice, at] = speeds[at], arrivals[choice, at]
