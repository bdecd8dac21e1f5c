"""The legs of a goal that leads through several poses, such as one of NavigateThroughPoses.

The server does not publish these poses, but paths through them: it joins the paths from pose to
pose. Where they meet, two places are the same, or only one heading differs, as paths of NavFn have
headings at their ends only. Otherwise the poses are the sharpest corners, if feedback says how many
there are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.geometry import FloatArray, IntArray, Pose, wrap_angles
from ator_ros.world.closest_approach import ClosestApproach

_SAME_PLACE = 0.002  # m
_SAME_HEADING = 0.002  # rad
_BESIDE = 0.3  # m on both sides of a corner, in which a path turns: planners cut and smooth them
_LEAST_CORNER = 0.35  # rad, above the turns of paths on a grid


@dataclass(frozen=True)
class Leg:
    """A part of a drive through poses.

    Attributes
    ----------
    begin, end : float
        In s.
    pose : Pose
        The pose that it leads to.
    path : ndarray, shape (n, 2)
        The part of the path that leads there, in m.
    is_passed : bool
        Whether it ends where the robot passes the pose. False: at a stop, or at a pose that was
        missed.
    nearest : float
        How near in m the robot has passed the pose.
    is_last : bool
        Whether it ends with the drive.
    """

    begin: float
    end: float
    pose: Pose
    path: FloatArray
    is_passed: bool
    nearest: float
    is_last: bool


def rows_of_poses(path: FloatArray, headings: FloatArray, count: int) -> list[int]:
    """Return the rows of a path (n, 2) at its poses, the last one of which ends it.

    Empty if nothing distinguishes them from other places. `headings` (n,) are in rad; `count` is
    the number of poses, 0: unknown.
    """
    last = len(path) - 1
    steps = np.hypot(*np.diff(path, axis=0).T)
    meets = steps <= _SAME_PLACE
    differs = np.abs(wrap_angles(headings - headings[0])) > _SAME_HEADING
    is_alone = ~differs[:-2] & differs[1:-1] & ~differs[2:]
    if 2 * differs.sum() < len(differs):  # as NavFn's
        meets[1:] |= is_alone
    joins = np.flatnonzero(meets[1:]) + 1
    joins = joins[np.diff(joins, append=last + 1) > 1]  # the last of neighbors
    if len(joins) < count - 1:
        joins = _corners(path, count - 1)
    return [*joins.tolist(), last] if len(joins) or count == 1 else []


def _corners(path: FloatArray, count: int) -> IntArray:
    """Return the rows of the `count` sharpest corners; none if a path has fewer."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    before = np.maximum(along - _BESIDE, 0.0)
    after = np.minimum(along + _BESIDE, along[-1])
    x, y = path.T
    came = np.arctan2(y - np.interp(before, along, y), x - np.interp(before, along, x))
    goes = np.arctan2(np.interp(after, along, y) - y, np.interp(after, along, x) - x)
    turns = np.abs(wrap_angles(goes - came))
    turns[(along < _BESIDE) | (along > along[-1] - _BESIDE)] = 0.0
    found: list[int] = []
    while len(found) < count and turns.max() >= _LEAST_CORNER:
        found.append(int(turns.argmax()))
        turns[np.abs(along - along[found[-1]]) < 2.0 * _BESIDE] = 0.0
    return np.array(sorted(found) if len(found) == count else [], dtype=int)


def legs_through(
    states: FloatArray,
    path: FloatArray,
    headings: FloatArray,
    rows: Sequence[int],
    tolerance: float,
) -> Iterator[Leg]:
    """Yield the legs of a drive from pose to pose.

    Parameters
    ----------
    states : ndarray, shape (m, k)
        Time in s, x and y in m, ..., during the drive.
    path, headings, rows : ndarray, ndarray, sequence of int
        See `rows_of_poses`.
    tolerance : float
        The distance in m within which a pose is passed.
    """
    times = states[:, 0]
    distances = [np.hypot(*(states[:, 1:3] - path[row]).T) for row in rows]
    begin = 0
    for number, row in enumerate(rows):
        x, y = path[row].tolist()
        pose = Pose(x, y, float(headings[row]))
        part = path[rows[number - 1] if number else 0 : row + 1]
        if number == len(rows) - 1:
            yield Leg(times[begin], times[-1], pose, part, False, math.nan, True)
            return
        limit = _first_within(distances[number + 1], tolerance, begin + 1)
        near = distances[number][: limit + 1]
        end = _first_within(near, tolerance, begin)
        is_passed = bool(near[end] <= tolerance)
        if not is_passed:
            end = begin + int(near[begin:].argmin())
        nearest = _nearest(distances[number][end:])
        yield Leg(times[begin], times[end], pose, part, is_passed, nearest, False)
        begin = end


def _first_within(distances: FloatArray, tolerance: float, begin: int) -> int:
    """Return the first row from `begin` on that is near enough; the last row without one."""
    near = np.flatnonzero(distances[begin:] <= tolerance)
    return begin + int(near[0]) if len(near) else len(distances) - 1


def _nearest(distances: FloatArray) -> float:
    """Return the least of the distances (n,) in m until the robot leaves."""
    approach = ClosestApproach()
    for distance in distances.tolist():
        if approach.leaves(distance):
            break
    return approach.distance
