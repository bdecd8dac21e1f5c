"""The search for the best subgoals of a whole chain (paper, section 4.3, for any number of variables).

The cost of a chain is a sum of terms, each of two neighbouring subgoals only. On a grid of candidates for
every subgoal, dynamic programming therefore finds the least sum exactly, with every term of every pair
evaluated once and vectorised. The grid is exhaustive where one variable is free; otherwise it is coarse first
and then refined around the best candidates.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.refinement.free_variables import Domain

StepCost = Callable[[int, FloatArray, FloatArray], FloatArray]
"""Gives the cost of step i, shape (n,), from the subgoals before and after it, shapes (n or 1, k)."""

SINGLE = 120
"""Candidates for one free variable on its own: 3 degrees of an angle. Nothing finer is searched then."""
ALONE = 432
"""First candidates of a subgoal with several free variables whose neighbours are fixed."""
PAIRED = 16
"""First candidates per free variable of a subgoal whose neighbour has free variables too."""
LEAST_STEPS = 4
ZOOM_STEPS = (7, 5, 3)
"""Steps of a window in each direction, for one, two, and more free variables."""
ZOOM_WINDOWS = 2


@dataclass(frozen=True, slots=True)
class Curve:
    """What was searched at one subgoal.

    Attributes
    ----------
    values : ndarray, shape (n, k)
        Candidates: values of the subgoal's k free variables.
    totals : ndarray, shape (n,)
        Least cost of the whole chain through each candidate.
    """

    values: FloatArray
    totals: FloatArray


@dataclass(frozen=True, slots=True)
class Optimum:
    """Best values of each subgoal's free variables, shapes (k,), the cost there, the first grid's curves."""

    values: tuple[FloatArray, ...]
    cost: float
    curves: tuple[Curve, ...]


def search(
    step_cost: StepCost, axes: Sequence[Sequence[Domain]], given: Sequence[FloatArray | None] | None = None
) -> Optimum:
    """Find the values of all free variables for which the cost of the whole chain is least.

    Parameters
    ----------
    step_cost : callable
        The cost of a step from the values of the subgoals on both its sides; step 0 starts from an array (1,
        0).
    axes : sequence, one item per subgoal
        Domains of the subgoal's free variables; empty where none is free.
    given : sequence, optional
        Values of each subgoal, shape (k,), that shall be among the candidates, so that the result is never
        worse.
    """
    grids, steps = _first_grids(tuple(map(tuple, axes)))
    candidates = grids
    if given is not None:
        candidates = [g if v is None else _with(g, v) for g, v in zip(grids, given, strict=True)]
    path, cost, totals = _least_path(step_cost, candidates)
    values = [c[i] for c, i in zip(candidates, path, strict=True)]
    curves = tuple(Curve(grid, total[: len(grid)]) for grid, total in zip(grids, totals, strict=True))
    if sum(len(domains) for domains in axes) > 1:
        candidates = [
            np.vstack([value, *(_window(best, step, domains) for best in _best_apart(c, t, step))])
            if domains
            else c
            for value, c, t, step, domains in zip(values, candidates, totals, steps, axes, strict=True)
        ]
        path, cost, _ = _least_path(step_cost, candidates)
        values = [c[i] for c, i in zip(candidates, path, strict=True)]
    return Optimum(tuple(values), cost, curves)


@lru_cache(maxsize=32)
def _first_grids(axes: tuple[tuple[Domain, ...], ...]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Give for each subgoal the first candidates, shape (n, k), and their distances, shape (k,).

    Plans are repeated, so grids are kept; nobody may write to them.
    """
    grids, steps = [], []
    for index, domains in enumerate(axes):
        neighbours = [axes[i] for i in (index - 1, index + 1) if 0 <= i < len(axes)]
        if any(neighbours):
            budget = float(PAIRED * len(domains))
        else:
            budget = float(SINGLE if len(domains) == 1 else ALONE)
        product = float(np.prod([domain.steps for domain in domains]))
        scale = (budget / product) ** (1.0 / max(len(domains), 1))
        counts = [max(LEAST_STEPS, round(domain.steps * scale)) for domain in domains]
        lines = [
            np.linspace(domain.low, domain.high, count, endpoint=not domain.periodic)
            for domain, count in zip(domains, counts, strict=True)
        ]
        grids.append(_product(lines))
        grids[-1].setflags(write=False)
        steps.append(np.array([line[1] - line[0] for line in lines]))
    return grids, steps


def _with(grid: FloatArray, given: FloatArray) -> FloatArray:
    """Give `grid` (n, k) and, after it, what is `given` (k,), where that is not among it already."""
    return grid if (grid == given).all(axis=1).any() else np.vstack([grid, given])


def _product(lines: Sequence[FloatArray]) -> FloatArray:
    """Give all combinations, shape (n, k), of the values on k lines; (1, 0) for none."""
    if not lines:
        return np.zeros((1, 0))
    return np.stack([axis.ravel() for axis in np.meshgrid(*lines, indexing="ij")], axis=1)


def _window(centre: FloatArray, step: FloatArray, domains: Sequence[Domain]) -> FloatArray:
    """Give candidates, shape (n, k), that divide the steps of the first grid around `centre`."""
    count = ZOOM_STEPS[min(len(domains), len(ZOOM_STEPS)) - 1]
    window = _product([c + s * np.linspace(-1.0, 1.0, count) for c, s in zip(centre, step, strict=True)])
    for column, domain in enumerate(domains):
        if domain.periodic:
            width = domain.high - domain.low
            window[:, column] = (window[:, column] - domain.low) % width + domain.low
        else:
            window[:, column] = np.clip(window[:, column], domain.low, domain.high)
    return window


def _best_apart(candidates: FloatArray, totals: FloatArray, step: FloatArray) -> list[FloatArray]:
    """Give the best candidates, at most ZOOM_WINDOWS, of which no two lie in one window."""
    chosen: list[FloatArray] = []
    left = totals.copy()
    for _ in range(min(ZOOM_WINDOWS, len(candidates))):
        index = int(np.argmin(left))
        if not np.isfinite(left[index]):
            break
        chosen.append(candidates[index])
        near = np.all(np.abs(candidates - candidates[index]) < 2.5 * step, axis=1)
        left[near] = np.inf
    return chosen


def _least_path(
    step_cost: StepCost, candidates: Sequence[FloatArray]
) -> tuple[list[int], float, list[FloatArray]]:
    """Give each subgoal's best candidate, the chain's cost, and the least cost through every candidate."""
    costs = [_pairwise(step_cost, 0, np.zeros((1, 0)), candidates[0])]
    for index, (before, after) in enumerate(itertools.pairwise(candidates), start=1):
        costs.append(_pairwise(step_cost, index, before, after))
    forward, origins = [costs[0][0]], [np.zeros(len(candidates[0]), dtype=int)]
    for cost in costs[1:]:
        sums = forward[-1][:, None] + cost
        origins.append(np.argmin(sums, axis=0))
        forward.append(sums[origins[-1], np.arange(sums.shape[1])])
    backward = [np.zeros(len(candidates[-1]))]
    for cost in reversed(costs[1:]):
        backward.insert(0, np.min(cost + backward[0][None, :], axis=1))
    index = int(np.argmin(forward[-1]))
    total, path = float(forward[-1][index]), [index]
    for origin in reversed(origins[1:]):
        path.insert(0, int(origin[path[0]]))
    return path, total, [f + b for f, b in zip(forward, backward, strict=True)]


def _pairwise(step_cost: StepCost, index: int, before: FloatArray, after: FloatArray) -> FloatArray:
    """Give the cost of a step, shape (n, m), for every pair of n candidates before and m after it."""
    n, m = len(before), len(after)
    if n > 1 and m > 1:
        rows = step_cost(index, np.repeat(before, m, axis=0), np.tile(after, (n, 1)))
    else:
        rows = step_cost(index, before, after)
    return rows.reshape(n, m) if len(rows) == n * m else np.full((n, m), rows[0])
