"""Routes along the paths of another planner, such as Nav2's (see `GridMap.planner`)."""

from __future__ import annotations

import math

import numpy as np

from ator_ros.geometry import FloatArray, wrap_angles

_TOLERANCE = 0.1  # m by which corners may differ from a path: the steps of a planner's cells are no turns


def measured_path(path: FloatArray, look_ahead: float) -> FloatArray:
    """Return length (m), turn, headings at departure and arrival (rad) of a path, and whether it is straight.

    Parameters
    ----------
    path : ndarray, shape (n, 2)
        Places in m, at least the start and the goal.
    look_ahead : float
        Length in m of the ends whose headings are taken.
    """
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    look = min(look_ahead, along[-1])
    after, before = (
        [np.interp(there, along, path[:, axis]) for axis in (0, 1)] for there in (look, along[-1] - look)
    )
    corners = _corners(path)
    headings = np.arctan2(*np.diff(corners, axis=0).T[::-1])
    turn = np.abs(wrap_angles(np.diff(headings))).sum()
    departure, arrival = (math.atan2(way[1], way[0]) for way in (after - path[0], path[-1] - before))
    return np.array([along[-1], turn, departure, arrival, len(corners) == 2])


def _corners(path: FloatArray) -> FloatArray:
    """Return the ends and corners of a path by the algorithm of Ramer, Douglas and Peucker."""
    chord = path[-1] - path[0]
    x, y = (path - path[0]).T
    away = np.abs(chord[0] * y - chord[1] * x) / max(math.hypot(*chord), 1e-9)
    farthest = int(away.argmax())
    if away[farthest] <= _TOLERANCE:
        return path[[0, -1]]
    return np.concatenate([_corners(path[: farthest + 1])[:-1], _corners(path[farthest:])])
