"""Routes along the paths of another planner, such as Nav2's (see `GridMap.planner`)."""

from __future__ import annotations

import math

import numpy as np

from ator_ros.geometry import FloatArray, wrap_angles

_TOLERANCE = 0.1  # m; greatest distance of a path from the straight lines between its corners


def route_along(path: FloatArray, look_ahead: float) -> tuple[float, float, float, float, bool]:
    """Return the route along a path: length in m; turn, departure, arrival in rad; is it straight.

    They are the fields of `ator_ros.bases.routes.RouteSet` of the same names, for one route.

    Parameters
    ----------
    path : ndarray, shape (n, 2)
        Places in m, at least the start and the goal.
    look_ahead : float
        Length in m of the first and last part of the path; departure and arrival are the directions
        across.
    """
    distances = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    length = float(distances[-1])
    look = min(look_ahead, length)
    first, last = (
        np.array([np.interp(distance, distances, path[:, axis]) for axis in (0, 1)])
        for distance in (look, length - look)
    )
    corners = _corners(path)
    turns = wrap_angles(np.diff(np.arctan2(*np.diff(corners, axis=0).T[::-1])))
    departure, arrival = (
        math.atan2(step[1], step[0]) for step in (first - path[0], path[-1] - last)
    )
    return length, float(np.abs(turns).sum()), departure, arrival, len(corners) == 2


def _corners(path: FloatArray) -> FloatArray:
    """Return the ends and corners of a path by the algorithm of Ramer, Douglas and Peucker.

    The turn of a route is summed at these. A planned path steps from cell to cell of a grid: the
    angles of all steps would add up to far more than the turn of its corners.
    """
    kept = {0, len(path) - 1}
    open_parts = [(0, len(path) - 1)]
    while open_parts:
        first, last = open_parts.pop()
        chord = path[last] - path[first]
        x, y = (path[first : last + 1] - path[first]).T
        offsets = np.abs(chord[0] * y - chord[1] * x) / max(math.hypot(*chord), 1e-9)
        farthest = first + int(offsets.argmax())
        if offsets[farthest - first] > _TOLERANCE:
            kept.add(farthest)
            open_parts += [(first, farthest), (farthest, last)]
    return path[sorted(kept)]
