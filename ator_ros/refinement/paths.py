"""The best chain through candidates of every subgoal: dynamic programming (paper, section 4.3).

The cost of a chain is a sum of terms, each of two neighbouring subgoals only. Among candidates for every
subgoal, dynamic programming therefore finds the least sum exactly, with every term of every pair evaluated
once and vectorised.

When time is up, the subgoals that follow keep what they had: the programming ends with one candidate for each
of them, and the result is the best for what was searched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.refinement.averaging import Averages, averaged
from ator_ros.refinement.candidates import place_of
from ator_ros.refinement.slices import Slices

StepCost = Callable[[int, FloatArray, FloatArray], FloatArray]
"""Returns the cost of step i, shape (n,), from the subgoals before and after it, shapes (n or 1, k)."""

BLOCK = 512
"""Pairs of candidates whose costs are computed at once: a slice, of a millisecond with the shipped models."""
_AT_ONCE = 4
"""Steps that are computed in one slice at most: each takes time, however few pairs it has."""


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

    It is not `complete` where time was up before everything was searched. `given` is the cost of what was
    given, where costs are averaged.
    """

    values: tuple[FloatArray, ...]
    cost: float
    curves: tuple[SearchCurve, ...]
    complete: bool = True
    given: float | None = None


@dataclass(frozen=True, slots=True)
class BestPath:
    """The best path through candidates: those considered, the values chosen, the least cost through each.

    `costs` are those of its steps. `given` is the cost of the path through what was given, where costs are
    averaged.
    """

    candidates: Sequence[FloatArray]
    values: list[FloatArray]
    cost: float
    costs: list[float]
    totals: list[FloatArray]
    complete: bool
    given: float | None = None


def best_apart(
    candidates: FloatArray, totals: FloatArray, step: FloatArray, *, most: int
) -> list[FloatArray]:
    """Return at most `most` of the best candidates, no two within 2.5 `step` (k,) of each other.

    Values are compared as they are: the ends of a circle are far apart.
    """
    chosen: list[FloatArray] = []
    left = totals.copy()
    for _ in range(min(most, len(candidates))):
        index = int(np.argmin(left))
        if not np.isfinite(left[index]):
            break
        chosen.append(candidates[index])
        near = np.all(np.abs(candidates - candidates[index]) < 2.5 * step, axis=1)
        left[near] = np.inf
    return chosen


def least_path(
    step_cost: StepCost,
    candidates: Sequence[FloatArray],
    given: Sequence[FloatArray],
    averages: Averages | None = None,
) -> Slices[BestPath]:
    """Find the best candidate of each subgoal; when time is up, only the `given` one of those that follow.

    With `averages` each cost is raised to the mean over neighbouring candidates where that is more.
    """
    searched: list[FloatArray] = []
    costs: list[FloatArray] = []
    forward: list[FloatArray] = []
    origins = []
    before, complete = np.zeros((1, 0)), True
    before_weights: FloatArray | None = None
    known: dict[int, FloatArray] = {}
    for index, offered in enumerate(candidates):
        after = offered if complete else given[index][None, :]
        if complete and index not in known:
            known = yield from _short_steps(step_cost, candidates, index, cut=bool(given))
        if complete and index in known:
            cost = known[index]
        else:
            cost = yield from _pairwise(step_cost, index, before, after, cut=complete and bool(given))
        if len(cost) < len(before):
            complete, after = False, given[index][None, :]
            cost = yield from _pairwise(step_cost, index, before, after, cut=False)
        if averages is not None:
            after_weights = averages.weights(index, after)
            cost = averaged(cost, before_weights, after_weights)
            before_weights = after_weights
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
    steps = [float(cost[i, j]) for cost, i, j in zip(costs, [0, *path], path, strict=False)]
    as_given = _cost_of(given, searched, costs) if averages is not None and given else None
    return BestPath(searched, values, total, steps, totals, complete, as_given)


def _cost_of(
    chain: Sequence[FloatArray], candidates: Sequence[FloatArray], costs: Sequence[FloatArray]
) -> float:
    """Return the cost of a chain whose values (k,) are among the candidates (n, k) of each subgoal."""
    row, total = 0, 0.0
    for values, searched, cost in zip(chain, candidates, costs, strict=True):
        column = place_of((searched, values)) or 0
        total += float(cost[row, column])
        row = column
    return total


def _short_steps(
    step_cost: StepCost, candidates: Sequence[FloatArray], first: int, *, cut: bool
) -> Slices[dict[int, FloatArray]]:
    """Compute the costs of several steps from the `first` on, as many as fit into one block of pairs.

    None needs those of another. Nothing is computed where there are no two such steps, or if time is up and
    the search may be `cut` short.
    """
    steps, pairs = [], 0
    for index in range(first, min(first + _AT_ONCE, len(candidates))):
        before = candidates[index - 1] if index else np.zeros((1, 0))
        pairs += len(before) * len(candidates[index])
        if pairs > BLOCK:
            break
        steps.append(partial(_block, step_cost, index, before, candidates[index]))
    if len(steps) < 2:
        return {}
    late = yield
    if late and cut:
        return {}
    return dict(enumerate([step() for step in steps], first))


def _pairwise(
    step_cost: StepCost, index: int, before: FloatArray, after: FloatArray, *, cut: bool
) -> Slices[FloatArray]:
    """Compute the cost of a step, shape (n, m), for every pair of n candidates before and m after it.

    Where that may be `cut` short, there are fewer rows if time is up.
    """
    size = max(1, BLOCK // len(after))
    blocks = []
    for first in range(0, len(before), size):
        late = yield
        if late and cut:
            break
        blocks.append(_block(step_cost, index, before[first : first + size], after))
    return blocks[0] if len(blocks) == 1 else np.concatenate([*blocks, np.zeros((0, len(after)))])


def _block(step_cost: StepCost, index: int, before: FloatArray, after: FloatArray) -> FloatArray:
    """Compute the cost of a step, shape (n, m), for every pair of n candidates before and m after it."""
    n, m = len(before), len(after)
    if n > 1 and m > 1:
        before, after = np.repeat(before, m, axis=0), np.tile(after, (n, 1))
    costs = step_cost(index, before, after)
    return np.full((n, m), costs[0]) if len(costs) == 1 else costs.reshape(n, m)
