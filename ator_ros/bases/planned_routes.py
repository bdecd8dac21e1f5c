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
    steps = np.diff(path, axis=0)
    distances = np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1])))
    length = float(distances[-1])
    look = min(look_ahead, length)
    corners = _corners(path)
    parts = np.diff(corners, axis=0)
    turns = wrap_angles(np.diff(np.arctan2(parts[:, 1], parts[:, 0])))
    departure = _heading(path[0], _place_at(look, distances, path))
    arrival = _heading(_place_at(length - look, distances, path), path[-1])
    return length, float(np.abs(turns).sum()), departure, arrival, len(corners) == 2


def _place_at(distance: float, distances: FloatArray, path: FloatArray) -> FloatArray:
    """Return the place on a path after a distance in m; `distances` are those of its places."""
    return np.array([np.interp(distance, distances, column) for column in path.T])


def _heading(start: FloatArray, end: FloatArray) -> float:
    x, y = end - start
    return math.atan2(y, x)


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
