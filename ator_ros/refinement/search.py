"""The search for the best subgoals of a whole chain (paper, section 4.3, for any number of variables).

The cost of a chain is a sum of terms, each of two neighbouring subgoals only. On a grid of candidates for
every subgoal, dynamic programming therefore finds the least sum exactly, with every term of every pair
evaluated once and vectorised. The grid is exhaustive where one variable is free; otherwise it is coarse first
and then refined around the best candidates.

When time is up, the subgoals that follow keep what they had: the programming ends with one candidate for each
of them, and the result is the best for what was searched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.refinement.slices import Slices, completed
from ator_ros.tops.ranges import Range

StepCost = Callable[[int, FloatArray, FloatArray], FloatArray]
"""Returns the cost of step i, shape (n,), from the subgoals before and after it, shapes (n or 1, k)."""

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
BLOCK = 384
"""Pairs of candidates whose costs are computed at once: about a millisecond, the length of a slice."""


@dataclass(frozen=True, slots=True)
class SearchCurve:
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
    """Best values of each subgoal's free variables, shapes (k,), the cost there, the first grid's curves.

    It is not `complete` where time was up before everything was searched.
    """

    values: tuple[FloatArray, ...]
    cost: float
    curves: tuple[SearchCurve, ...]
    complete: bool = True


@dataclass(frozen=True, slots=True)
class _Path:
    """The best path through candidates: those considered, the values chosen, the least cost through each."""

    candidates: Sequence[FloatArray]
    values: list[FloatArray]
    cost: float
    totals: list[FloatArray]
    complete: bool


def search(
    step_cost: StepCost, axes: Sequence[Sequence[Range]], given: Sequence[FloatArray] | None = None
) -> Optimum:
    """Find the values of all free variables for which the cost of the whole chain is least.

    Parameters
    ----------
    step_cost : callable
        The cost of a step from the values of the subgoals on both its sides; step 0 starts from an array (1,
        0).
    axes : sequence, one item per subgoal
        Domains of the subgoal's free variables; empty where none is free.
    given : sequence, one item per subgoal, optional
        Values of each subgoal, shape (k,), that shall be among the candidates, so that the result is never
        worse.
    """
    return completed(searching(step_cost, axes, given))


def searching(
    step_cost: StepCost, axes: Sequence[Sequence[Range]], given: Sequence[FloatArray] | None = None
) -> Slices[Optimum]:
    """Search as `search` does, in slices; when time is up, subgoals not yet searched keep what is `given`.

    Without given values, all of the first grid is searched nevertheless.
    """
    grids, steps = _first_grids(tuple(map(tuple, axes)))
    known = list(given) if given is not None else []
    candidates = [_with(g, v) for g, v in zip(grids, known, strict=True)] if known else grids
    first = yield from _least_path(step_cost, candidates, known)
    curves = tuple(
        SearchCurve(grid, total[: len(grid)]) if searched is offered else SearchCurve(searched, total)
        for grid, offered, searched, total in zip(
            grids, candidates, first.candidates, first.totals, strict=True
        )
    )
    if sum(len(domains) for domains in axes) <= 1 or not first.complete:
        return Optimum(tuple(first.values), first.cost, curves, first.complete)
    windows = []
    for value, offered, total, step, domains in zip(
        first.values, candidates, first.totals, steps, axes, strict=True
    ):
        yield
        best = _best_apart(offered, total, step) if domains else []
        zoomed = [_window(centre, step, domains) for centre in best]
        windows.append(np.vstack([value, *zoomed]) if domains else offered)
    second = yield from _least_path(step_cost, windows, first.values)
    return Optimum(tuple(second.values), second.cost, curves, second.complete)


def unsearched(given: Sequence[FloatArray], cost: float) -> Optimum:
    """Return what is known without any search: the values of each subgoal, shapes (k,), and their cost."""
    curves = tuple(SearchCurve(values[None, :], np.array([cost])) for values in given)
    return Optimum(tuple(given), cost, curves, complete=False)


@lru_cache(maxsize=32)
def _first_grids(axes: tuple[tuple[Range, ...], ...]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return for each subgoal the first candidates, shape (n, k), and their distances, shape (k,).

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
    """Return `grid` (n, k) and, after it, what is `given` (k,), where that is not among it already."""
    return grid if (grid == given).all(axis=1).any() else np.vstack([grid, given])


def _product(lines: Sequence[FloatArray]) -> FloatArray:
    """Return all combinations, shape (n, k), of the values on k lines; (1, 0) for none."""
    if not lines:
        return np.zeros((1, 0))
    return np.stack([axis.ravel() for axis in np.meshgrid(*lines, indexing="ij")], axis=1)


def _window(centre: FloatArray, step: FloatArray, domains: Sequence[Range]) -> FloatArray:
    """Return candidates, shape (n, k), that divide the steps of the first grid around `centre`."""
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
    """Return the best candidates, at most ZOOM_WINDOWS, of which no two lie in one window."""
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
    step_cost: StepCost, candidates: Sequence[FloatArray], given: Sequence[FloatArray]
) -> Slices[_Path]:
    """Find the best candidate of each subgoal; when time is up, only the `given` one of those that follow."""
    searched: list[FloatArray] = []
    costs: list[FloatArray] = []
    forward: list[FloatArray] = []
    origins = []
    before, complete = np.zeros((1, 0)), True
    for index, offered in enumerate(candidates):
        after = offered if complete else given[index][None, :]
        cost = yield from _pairwise(step_cost, index, before, after, cut=complete and bool(given))
        if len(cost) < len(before):
            complete, after = False, given[index][None, :]
            cost = yield from _pairwise(step_cost, index, before, after, cut=False)
        sums = forward[-1][:, None] + cost if forward else cost
        origins.append(np.argmin(sums, axis=0))
        forward.append(sums[origins[-1], np.arange(sums.shape[1])])
        costs.append(cost)
        searched.append(after)
        before = after
    backward = [np.zeros(len(before))]
    for cost in reversed(costs[1:]):
        yield
        backward.insert(0, np.min(cost + backward[0][None, :], axis=1))
    row = int(np.argmin(forward[-1]))
    total, path = float(forward[-1][row]), [row]
    for origin in reversed(origins[1:]):
        path.insert(0, int(origin[path[0]]))
    values = [c[i] for c, i in zip(searched, path, strict=True)]
    totals = [f + b for f, b in zip(forward, backward, strict=True)]
    return _Path(searched, values, total, totals, complete)


def _pairwise(
    step_cost: StepCost, index: int, before: FloatArray, after: FloatArray, *, cut: bool
) -> Slices[FloatArray]:
    """Compute the cost of a step, shape (n, m), for every pair of n candidates before and m after it.

    Where that may be `cut` short, there are fewer rows if time is up.
    """
    n, m = len(before), len(after)
    size = max(1, BLOCK // m)
    blocks = [np.zeros((0, m))]
    for first in range(0, n, size):
        late = yield
        if late and cut:
            break
        part = before[first : first + size]
        if n > 1 and m > 1:
            rows = step_cost(index, np.repeat(part, m, axis=0), np.tile(after, (len(part), 1)))
        else:
            rows = step_cost(index, part, after)
        every = len(rows) == len(part) * m
        blocks.append(rows.reshape(len(part), m) if every else np.full((len(part), m), rows[0]))
    return np.concatenate(blocks)
