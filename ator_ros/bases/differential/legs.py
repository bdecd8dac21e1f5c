"""The fastest drives between poses: an opening, in which the robot stops turning, and a path."""

from __future__ import annotations

import math

import numpy as np

from ator_ros.bases.differential.driving import DrivingStyle
from ator_ros.bases.differential.durations import turn_time
from ator_ros.bases.differential.shapes import fastest_paths
from ator_ros.bases.direct import HOLD, NEAR, SPEEDG, XG, YAW, YAWG, YG, V, W, X, Y, wrapped
from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray
from ator_ros.world.state import AT_REST

_REST_V = AT_REST.speed
_REST_W = AT_REST.w
_ALIGNED = 0.1
"""Angle in rad up to which a robot may turn on the spot with an object in front."""


def fastest_drives(legs: FloatArray, driving: DrivingStyle, hold: float, aw: float) -> FloatArray:
    """Return times (s) and angles turned (rad) of the fastest drives, shape (2, n).

    A robot at rest near its goal turns on the spot.

    Parameters
    ----------
    legs : ndarray, shape (m, n)
        Direct variables, see `ator_ros.bases.direct`.
    driving : DrivingStyle
        How the action drives.
    hold : float
        Distance in m from the axle to a held object.
    aw : float
        Greatest change of the turn rate in the opening, in rad/s^2.
    """
    ends, opening, on_spot = ends_of(legs, hold, aw)
    holding = legs[HOLD] > 0.5
    held = np.count_nonzero(holding)
    if held:
        paths = fastest_paths(ends, driving.approach_paths, hold=hold)
    if held < len(holding):
        drives = fastest_paths(ends, driving.drive_paths, hold=0.0)
        paths = np.where(holding, paths, drives) if held else drives
    _add_openings(paths, opening, on_spot, driving.limits.w, driving.limits.aw)
    return paths


def ends_of(legs: FloatArray, hold: float, aw: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what the paths of n legs begin and end with; see `fastest_drives`.

    Returns
    -------
    ends : ndarray, shape (5, n)
        Both ends of the paths after the opening, see `fastest_paths`.
    opening : ndarray, shape (n,)
        Duration of the opening in s.
    on_spot : ndarray, shape (n,)
        Angle in rad by which the robot turns on the spot instead; NaN if it drives.
    """
    ends = np.empty((5, legs.shape[1]))
    opening = np.empty(legs.shape[1])
    on_spot = np.empty(legs.shape[1])
    _write_ends(legs, hold, aw, ends, opening, on_spot)
    return ends, opening, on_spot


@compiled
def _write_ends(
    legs: FloatArray,
    hold: float,
    aw: float,
    ends: FloatArray,
    opening: FloatArray,
    on_spot: FloatArray,
) -> None:
    """Write the results of `ends_of`.

    In the opening the robot loses its rotation at up to `aw` (rad/s^2), while its speed stays the
    same.
    """
    for at in range(legs.shape[1]):
        speed = legs[V, at]
        rotation = legs[W, at]
        yaw = legs[YAW, at]
        from_x = legs[X, at]
        from_y = legs[Y, at]
        heading = legs[YAWG, at]
        arrival = legs[SPEEDG, at]
        back = hold * legs[HOLD, at]
        x = legs[XG, at] - back * math.cos(heading)
        y = legs[YG, at] - back * math.sin(heading)
        dx = x - from_x
        dy = y - from_y
        starts_at_rest = abs(speed) <= _REST_V and abs(rotation) <= _REST_W
        turns = starts_at_rest and arrival <= _REST_V and math.sqrt(dx * dx + dy * dy) < NEAR
        angle = abs(wrapped(heading - yaw))
        free = legs[HOLD, at] < 0.5 or angle <= _ALIGNED
        on_spot[at] = angle if turns and free else math.nan
        time = abs(rotation) * (1.0 / aw)
        half = 0.5 * rotation * time
        mean = yaw + (2.0 / 3.0) * half
        distance = speed * time
        dx = x - (from_x + distance * math.cos(mean))
        dy = y - (from_y + distance * math.sin(mean))
        opened_yaw = yaw + half
        cos = math.cos(opened_yaw)
        sin = math.sin(opened_yaw)
        opening[at] = time
        ends[0, at] = cos * dx + sin * dy
        ends[1, at] = cos * dy - sin * dx
        ends[2, at] = wrapped(heading - opened_yaw)
        ends[3, at] = speed
        ends[4, at] = arrival


@compiled
def _add_openings(
    paths: FloatArray, opening: FloatArray, on_spot: FloatArray, w: float, aw: float
) -> None:
    """Add the openings to paths, shape (2, n), or replace them by turns on the spot.

    These have rates up to `w` (rad/s), which change by up to `aw` (rad/s^2).
    """
    for at in range(paths.shape[1]):
        paths[0, at] += opening[at]
        if not math.isnan(on_spot[at]):
            paths[0, at] = turn_time(on_spot[at], w, aw)
            paths[1, at] = on_spot[at]
