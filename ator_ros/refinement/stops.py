"""Whether the robot stops at a subgoal: the candidates on the table of an order search.

A robot that passes a subgoal begins the next leg in the direction in which it comes. A table has
legs from any call to any other, so a subgoal that may be passed has a candidate for each of some
directions, in its heading. A leg leads to the one that is nearest to the leg's own direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ator_ros.actions.goal_variables import STOP
from ator_ros.geometry import BoolArray, FloatArray, wrap_angles
from ator_ros.refinement.search import Allowed
from ator_ros.tops.chain import TopCall
from ator_ros.tops.ordering import Ordering


def table_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the columns of a call's candidates, for the names of its free variables."""
    return (*names, "yaw") if STOP in names and "yaw" not in names else names


def while_stopping(allowed: Allowed | None, names: Sequence[str]) -> Allowed | None:
    """Return the limits of candidates without the column of `STOP`, of calls that stop."""
    if allowed is None or STOP not in names:
        return allowed
    column = names.index(STOP)
    return lambda index, points: allowed(index, np.insert(points, column, 1.0, axis=1))


def with_passing(
    points: FloatArray,
    names: tuple[str, ...],
    values: Mapping[str, float],
    directions: int,
) -> FloatArray:
    """Return the candidates of a call that may be passed, shape (n + directions, k).

    Parameters
    ----------
    points : ndarray, shape (n, m)
        Values of its other free variables, at which it stops.
    names : tuple of str
        Names of its k columns, see `table_names`.
    values : mapping
        Its goal variables.
    directions : int
        Number of candidates that pass it.
    """
    given = np.array([values[name] for name in names])
    stopping = np.tile(given, (len(points), 1))
    others = [column for column, name in enumerate(names) if name != STOP]
    stopping[:, others[: points.shape[1]]] = points
    stopping[:, names.index(STOP)] = 1.0
    passing = np.tile(given, (directions, 1))
    passing[:, names.index(STOP)] = 0.0
    evenly = np.linspace(-math.pi, math.pi, directions, endpoint=False)
    passing[:, names.index("yaw")] = evenly
    return np.vstack((stopping, passing))


def passing_rows(candidates: FloatArray, names: tuple[str, ...]) -> BoolArray:
    """Return which candidates (n, k) of a call pass it, shape (n,)."""
    if STOP not in names:
        return np.zeros(len(candidates), dtype=bool)
    return np.asarray(candidates[:, names.index(STOP)] == 0.0)


def reached(candidates: FloatArray, names: tuple[str, ...], direction: float) -> BoolArray:
    """Return which candidates (n, k) a leg leads to that arrives in a direction (rad)."""
    passing = passing_rows(candidates, names)
    if not passing.any():
        return ~passing
    off = np.abs(wrap_angles(candidates[:, names.index("yaw")] - direction))
    off[~passing] = math.inf
    nearest = np.zeros(len(candidates), dtype=bool)
    nearest[off.argmin()] = True
    return ~passing | nearest


def costs_of_end(
    candidates: Sequence[FloatArray],
    names: Sequence[tuple[str, ...]],
    ordering: Ordering,
    width: int,
    calls: Sequence[TopCall],
) -> FloatArray:
    """Return the costs of ending with each candidate of each call, shape (n + 1, width).

    The first row is of the start. They are infinite for candidates that pass the last call, and for
    calls that pass it and do not open that.
    """
    costs = np.zeros((len(candidates) + 1, width))
    for index in ordering.groups[-1]:
        passing = passing_rows(candidates[index], names[index])
        costs[index + 1, : len(passing)][passing] = math.inf
        if calls[index].passing and not calls[index].may_stop:
            costs[index + 1] = math.inf
    return costs
