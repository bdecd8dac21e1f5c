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


def may_pass(call: TopCall, names: tuple[str, ...]) -> bool:
    """Return whether the robot may pass a call, for the names of its free variables."""
    return STOP in names or call.passing


def table_names(call: TopCall, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the columns of a call's candidates, for the names of its free variables."""
    return (*names, "yaw") if may_pass(call, names) and "yaw" not in names else names


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
        Values of its free variables but `STOP`, at which it stops; none if it cannot stop.
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
    passing = np.tile(given, (directions, 1))
    evenly = np.linspace(-math.pi, math.pi, directions, endpoint=False)
    passing[:, names.index("yaw")] = evenly
    if STOP in names:
        stopping[:, names.index(STOP)] = 1.0
        passing[:, names.index(STOP)] = 0.0
    return np.vstack((stopping, passing))


def passing_rows(
    call: TopCall,
    candidates: FloatArray,
    names: tuple[str, ...],
) -> BoolArray:
    """Return with which candidates (n, k) the robot passes a call, shape (n,)."""
    if STOP not in names:
        return np.full(len(candidates), call.passing)
    return np.asarray(candidates[:, names.index(STOP)] == 0.0)


def reached(
    call: TopCall,
    candidates: FloatArray,
    names: tuple[str, ...],
    direction: float,
) -> BoolArray:
    """Return which candidates (n, k) a leg leads to that arrives in a direction (rad)."""
    passing = passing_rows(call, candidates, names)
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

    The first row is of the start. They are 0 where a call can be the last one and the robot may
    stop there, and infinite elsewhere.
    """
    costs = np.full((len(candidates) + 1, width), math.inf)
    for index in ordering.groups[-1]:
        call = calls[index]
        may_end = ~passing_rows(call, candidates[index], names[index])
        if call.may_stop and STOP not in names[index]:  # nothing depends on it but the end
            may_end[:] = True
        costs[index + 1, : len(may_end)][may_end] = 0.0
    return costs
