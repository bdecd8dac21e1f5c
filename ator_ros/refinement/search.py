"""The search for the best subgoals of a whole chain (paper, section 4.3, for any number of variables).

The cost of a chain is a sum of terms, each of which depends on two neighboring subgoals only. Dynamic
programming therefore finds the best path through candidates for every subgoal exactly, with every term
evaluated once for each pair and vectorized.

The candidates form a grid where subgoals have at most two free variables. The grid is exhaustive for a single
variable. Otherwise it is coarse, and coordinate descent then refines the subgoals of the best path one after
the other. Where a subgoal has more free variables, or a region limits its candidates, they are spread evenly
and then drawn from boxes that shrink around the best path. Nothing is random: the same request has the same
answer.

The core reads no clock. The caller passes a `Deadline`, which is checked between blocks of candidates. Once
time is up, the subgoals that have not been searched keep their given values.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.tops.ranges import Range

StepCost = Callable[[int, FloatArray, FloatArray], FloatArray]
"""Returns the cost of step i, shape (n,), from the subgoals before and after it, shapes (n or 1, k)."""
Allowed = Callable[[int, FloatArray], BoolArray]
"""Returns which candidates (n, k) of a subgoal its region allows, shape (n,)."""
Deadline = Callable[[], bool]
"""Returns whether time is up."""
Widths = Mapping[str, float]
"""Standard deviation of the averaging kernel by goal variable, in its unit; no entry: no averaging."""

BLOCK = 512
"""Pairs of candidates evaluated between two checks of the deadline: a millisecond with the shipped models."""

# The grid
_SINGLE = 120  # candidates for a single free variable: 3 degrees of an angle
_ALONE = 432  # of a subgoal with several free variables whose neighbors are fixed
_PAIRED = 24  # of a subgoal next to another one with free variables: all pairs are evaluated
_LEAST_STEPS = 3
_ROUNDS = 4  # of coordinate descent for neighboring free subgoals, each in windows half as wide
_ZOOM_STEPS = (9, 5)  # of a window in each direction, for one and two free variables
_ZOOM_WINDOWS = 2  # number of best candidates with a window around them in the first round
_MOST_ON_GRID = 2  # free variables of a subgoal that are searched on a grid

# Boxes
_BOX_FIRST = (1, 16, 12, 64, 150)  # first candidates of a subgoal by number of free variables
_BOX_AROUND = (1, 5, 6, 16, 24)  # candidates in a box by number of free variables
_BOX_ALONE = 400  # first candidates of a subgoal whose neighbors are fixed
_BOX_BESIDE = 48  # of one with more than two free variables next to another such one
_LEAST_ROUNDS, _MOST_ROUNDS = 14, 20  # for up to six free variables in total, and for twelve or more
_SHRINKS = 0.75  # least factor by which a box shrinks in a round
_REACH = 2.0  # least half width of a box in multiples of the last move of the best candidate
_TRIES = 40  # points tested for each wanted candidate, of _POINTS
_POINTS = 1 << 13


class NoCandidateError(ValueError):
    """No tested point lies in the allowed region, and no values are given."""


def no_deadline() -> bool:
    """Return False: a deadline that never passes."""
    return False


class SearchCurve(NamedTuple):
    """The candidates of one subgoal.

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
    """The result of a search.

    Attributes
    ----------
    values : sequence of ndarray, shapes (k,)
        Best values of each subgoal's free variables.
    cost : float
        Cost of the chain with these values.
    curves : sequence of SearchCurve
        First candidates, by subgoal.
    complete : bool
        False if the deadline ended the search.
    given_cost : float or None
        Cost of the given values, where costs are averaged.
    costs : sequence of float
        Costs of the steps, where only one set of candidates was searched.
    """

    values: Sequence[FloatArray]
    cost: float
    curves: Sequence[SearchCurve]
    complete: bool = True
    given_cost: float | None = None
    costs: Sequence[float] = ()


@dataclass(frozen=True, slots=True)
class Averages:
    """Averages of costs over neighboring candidates, so that a choice does not follow single errors.

    A search prefers candidates whose cost is predicted too low. Where models err by as much as candidates
    differ, and neighbors err independently, the mean over neighbors is the better estimate (kernel regression
    after Nadaraya and Watson, with a normal kernel). But a mean hides steps, which are real where a maneuver
    barely fits. So the cost of a candidate is its prediction or the mean of its neighbors, whichever is more.
    The gate's file sets the width of the kernel. Candidates of a grid that is wider have no neighbors.

    Attributes
    ----------
    axes, widths : sequences, one item per subgoal
        Domains of the subgoal's k free variables, and widths of the kernel; candidates that differ in a
        variable of width 0 are no neighbors.
    """

    axes: Sequence[Sequence[Range]]
    widths: Sequence[Sequence[float]]

    def weights(self, index: int, candidates: FloatArray) -> FloatArray | None:
        """Return the weights (n, n) of candidates (n, k) in the mean of each; None if nothing is averaged."""
        if len(candidates) == 1 or not any(self.widths[index]):
            return None
        exponent = np.zeros((len(candidates), len(candidates)))
        for values, domain, width in zip(candidates.T, self.axes[index], self.widths[index], strict=True):
            apart = np.abs(values[:, None] - values)
            if domain.periodic:
                apart %= domain.high - domain.low  # given values may be turns away
                apart = np.minimum(apart, (domain.high - domain.low) - apart)
            exponent += (apart / width) ** 2 if width else np.where(apart > 0.0, np.inf, 0.0)
        weights: FloatArray = np.exp(-0.5 * exponent)
        return weights


def search(
    step_cost: StepCost,
    axes: Sequence[Sequence[Range]],
    given: Sequence[FloatArray] | None = None,
    *,
    allowed: Allowed | None = None,
    averages: Averages | None = None,
    deadline: Deadline = no_deadline,
) -> Optimum:
    """Find the values of all free variables with the least cost of the whole chain.

    Parameters
    ----------
    step_cost : callable
        Step 0 starts from an array (1, 0).
    axes : sequence, one item per subgoal
        Domains of the subgoal's free variables; empty where none is free.
    given : sequence, one item per subgoal, optional
        Values of each subgoal, shape (k,), that are among the candidates, so that the result is never worse.
    allowed : callable, optional
        Limits the candidates, but for given values.
    averages : Averages, optional
        How costs are averaged over neighbors on the grid; candidates that are spread evenly have none.
    deadline : callable, optional
        Once it has passed, subgoals that have not been searched keep their given values. Without given values
        all first candidates are evaluated nevertheless.

    Raises
    ------
    NoCandidateError
        No tested point is allowed, and no values are given.
    """
    if allowed is not None or max(map(len, axes)) > _MOST_ON_GRID:
        return _search_boxes(step_cost, axes, given, allowed, deadline)
    return _search_grid(step_cost, axes, given, averages, deadline)


def unsearched(given: Sequence[FloatArray], cost: float) -> Optimum:
    """Return the result of no search: the values of each subgoal, shapes (k,), and their cost."""
    curves = [SearchCurve(values[None, :], np.array([cost])) for values in given]
    return Optimum(given, cost, curves, complete=False)


# Dynamic programming


def least_path(
    step_cost: StepCost,
    candidates: Sequence[FloatArray],
    given: Sequence[FloatArray],
    averages: Averages | None = None,
    deadline: Deadline = no_deadline,
) -> Optimum:
    """Find the best candidate of each subgoal; once time is up, subgoals that follow keep the `given` one."""
    searched: list[FloatArray] = []
    costs: list[FloatArray] = []
    forward: list[FloatArray] = []
    origins = []
    before, complete = np.zeros((1, 0)), True
    before_weights: FloatArray | None = None
    for index, offered in enumerate(candidates):
        after = offered if complete else given[index][None, :]
        cost = _pairwise(step_cost, index, before, after, deadline if complete and given else no_deadline)
        if len(cost) < len(before):
            complete, after = False, given[index][None, :]
            cost = _pairwise(step_cost, index, before, after, no_deadline)
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
        backward.insert(0, np.min(cost + backward[0][None, :], axis=1))
    row = int(np.argmin(forward[-1]))
    total, path = float(forward[-1][row]), [row]
    for origin in reversed(origins[1:]):
        path.insert(0, int(origin[path[0]]))
    values = [c[i] for c, i in zip(searched, path, strict=True)]
    curves = [SearchCurve(c, f + b) for c, f, b in zip(searched, forward, backward, strict=True)]
    steps = [float(cost[i, j]) for cost, i, j in zip(costs, [0, *path], path, strict=False)]
    as_given = _cost_of(given, searched, costs) if averages is not None and given else None
    return Optimum(values, total, curves, complete, as_given, steps)


def _pairwise(
    step_cost: StepCost, index: int, before: FloatArray, after: FloatArray, deadline: Deadline
) -> FloatArray:
    """Return the cost (n, m) of a step for n candidates before and m after it; fewer rows if time is up."""
    size = max(1, BLOCK // len(after))
    blocks = []
    for first in range(0, len(before), size):
        if deadline():
            break
        blocks.append(_block(step_cost, index, before[first : first + size], after))
    return blocks[0] if len(blocks) == 1 else np.concatenate([*blocks, np.zeros((0, len(after)))])


def _block(step_cost: StepCost, index: int, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the cost (n, m) of a step for every pair of n candidates before and m after it."""
    n, m = len(before), len(after)
    if n > 1 and m > 1:
        before, after = np.repeat(before, m, axis=0), np.tile(after, (n, 1))
    costs = step_cost(index, before, after)
    return np.full((n, m), costs[0]) if len(costs) == 1 else costs.reshape(n, m)


def _cost_of(
    chain: Sequence[FloatArray], candidates: Sequence[FloatArray], costs: Sequence[FloatArray]
) -> float:
    """Return the cost of a chain whose values (k,) are among the candidates (n, k) of each subgoal."""
    row, total = 0, 0.0
    for values, searched, cost in zip(chain, candidates, costs, strict=True):
        column = row_of((searched, values)) or 0
        total += float(cost[row, column])
        row = column
    return total


def averaged(cost: FloatArray, before: FloatArray | None, after: FloatArray | None) -> FloatArray:
    """Return the cost of a step for n candidates before and m after it, or the mean over both if it is more.

    Parameters
    ----------
    cost : ndarray, shape (n, m)
        Infinite costs are left out of the means of their neighbors.
    before, after : ndarray, shapes (n, n) and (m, m), or None
        Weights; None where nothing is averaged.
    """
    finite = np.isfinite(cost)
    sums, weights = np.where(finite, cost, 0.0), finite.astype(float)
    if before is not None:
        sums, weights = before @ sums, before @ weights
    if after is not None:
        sums, weights = sums @ after.T, weights @ after.T
    means = sums / np.where(finite, weights, 1.0)
    return np.maximum(cost, means)


def row_of(*pairs: tuple[FloatArray, FloatArray]) -> int | None:
    """Return the first row in which each table (n or 1, k) equals its candidate (k,); None if none does.

    It is row 0 where nothing is free.
    """
    same: BoolArray | None = None
    for table, candidate in pairs:
        for column, value in enumerate(candidate.tolist()):
            equal: BoolArray = table[:, column] == value
            same = equal if same is None else same & equal
    if same is None:
        return 0
    row = int(same.argmax())
    return row if same[row] else None


# Grid and coordinate descent


def _search_grid(
    step_cost: StepCost,
    axes: Sequence[Sequence[Range]],
    given: Sequence[FloatArray] | None,
    averages: Averages | None,
    deadline: Deadline,
) -> Optimum:
    grids, steps = _first_grids(tuple(map(tuple, axes)))
    known = list(given) if given is not None else []
    candidates = [_with_candidate(*each) for each in zip(grids, known, strict=True)] if known else grids
    first = least_path(step_cost, candidates, known, averages, deadline)
    curves = [
        SearchCurve(grid, curve.totals[: len(grid)]) if curve.values is offered else curve
        for grid, offered, curve in zip(grids, candidates, first.curves, strict=True)
    ]
    if sum(len(domains) for domains in axes) <= 1 or not first.complete:
        return dataclasses.replace(first, curves=curves)
    centers = [
        best_apart(*curve, step) if domains else []
        for curve, step, domains in zip(first.curves, steps, axes, strict=True)
    ]
    values, costs = list(first.values), list(first.costs)
    rounds = _ROUNDS if any(axes[i] and axes[i + 1] for i in range(len(axes) - 1)) else 1
    for number in range(rounds):
        for index, domains in enumerate(axes):
            if not domains:
                continue
            if deadline():
                return Optimum(values, sum(costs), curves, complete=False, given_cost=first.given_cost)
            around, step = (centers[index] if number == 0 else [values[index]]), steps[index] * 0.5**number
            windows = [_window(center, step, domains) for center in around]
            window = _distinct(np.vstack([values[index], *windows]))
            beside = _costs_beside(step_cost, values, index, window, averages)
            best = int(np.argmin(sum(beside[1:], start=beside[0])))
            values[index] = window[best]
            costs[index : index + 2] = [float(cost[best]) for cost in beside]
    return Optimum(values, sum(costs), curves, given_cost=first.given_cost)


def _costs_beside(
    step_cost: StepCost,
    values: Sequence[FloatArray],
    index: int,
    candidates: FloatArray,
    averages: Averages | None,
) -> list[FloatArray]:
    """Return the costs, shapes (n,), of the step to a subgoal and of the one after it, if there is one."""
    weights = averages.weights(index, candidates) if averages is not None else None
    before = values[index - 1][None, :] if index else np.zeros((1, 0))
    leading = np.broadcast_to(step_cost(index, before, candidates), len(candidates))
    leading = averaged(leading[None, :], None, weights)[0] if averages is not None else leading
    if index + 1 == len(values):
        return [leading]
    following = np.broadcast_to(step_cost(index + 1, candidates, values[index + 1][None, :]), len(candidates))
    following = averaged(following[:, None], weights, None)[:, 0] if averages is not None else following
    return [leading, following]


@lru_cache(maxsize=32)
def _first_grids(axes: tuple[tuple[Range, ...], ...]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return for each subgoal the first candidates, shape (n, k), and their distances, shape (k,).

    The cached arrays are read-only.
    """
    grids, steps = [], []
    for index, domains in enumerate(axes):
        neighbors = [axes[i] for i in (index - 1, index + 1) if 0 <= i < len(axes)]
        budget = _PAIRED if any(neighbors) else _SINGLE if len(domains) == 1 else _ALONE
        product = float(np.prod([domain.steps for domain in domains]))
        scale = (budget / product) ** (1.0 / max(len(domains), 1))
        counts = [max(_LEAST_STEPS, round(domain.steps * scale)) for domain in domains]
        lines = [
            np.linspace(domain.low, domain.high, count, endpoint=not domain.periodic)
            for domain, count in zip(domains, counts, strict=True)
        ]
        grids.append(_product(lines))
        grids[-1].setflags(write=False)
        steps.append(np.array([line[1] - line[0] for line in lines]))
    return grids, steps


def best_apart(candidates: FloatArray, totals: FloatArray, step: FloatArray) -> list[FloatArray]:
    """Return the `_ZOOM_WINDOWS` best candidates, no two within 2.5 `step` (k,) of each other.

    Values are compared as they are: the ends of a circle are far apart.
    """
    chosen: list[FloatArray] = []
    left = totals.copy()
    for _ in range(min(_ZOOM_WINDOWS, len(candidates))):
        index = int(np.argmin(left))
        if not np.isfinite(left[index]):
            break
        chosen.append(candidates[index])
        near = np.all(np.abs(candidates - candidates[index]) < 2.5 * step, axis=1)
        left[near] = np.inf
    return chosen


def _with_candidate(table: FloatArray, candidate: FloatArray) -> FloatArray:
    """Return a table of candidates with another one appended, if it is not in the table."""
    there = row_of((table, candidate)) is not None
    return table if there else np.concatenate((table, candidate[None, :]))


def _distinct(candidates: FloatArray) -> FloatArray:
    """Return `candidates` (n, k) without repetitions."""
    return np.array(list(dict.fromkeys(map(tuple, candidates.tolist()))))


def _product(lines: Sequence[FloatArray]) -> FloatArray:
    """Return all combinations, shape (n, k), of the values on k lines; (1, 0) for none."""
    if not lines:
        return np.zeros((1, 0))
    return np.stack([axis.ravel() for axis in np.meshgrid(*lines, indexing="ij")], axis=1)


def _window(center: FloatArray, step: FloatArray, domains: Sequence[Range]) -> FloatArray:
    """Return candidates, shape (n, k), that divide the steps of the first grid around `center`."""
    count = _ZOOM_STEPS[len(domains) - 1]
    window = _product([c + s * np.linspace(-1.0, 1.0, count) for c, s in zip(center, step, strict=True)])
    into_domains(window, domains)
    return window


# Boxes


def _search_boxes(
    step_cost: StepCost,
    axes: Sequence[Sequence[Range]],
    given: Sequence[FloatArray] | None,
    allowed: Allowed | None,
    deadline: Deadline,
) -> Optimum:
    boxes = [_Box(index, domains, allowed) for index, domains in enumerate(axes)]
    firsts = [box.spread(_count(axes, box.index)) for box in boxes]
    if given is None and not all(map(len, firsts)):
        raise NoCandidateError("expected candidates of every subgoal, got none")
    known = [] if given is None else list(given)
    offered = [_joined(v, first) for v, first in zip(known, firsts, strict=True)] if known else firsts
    path = least_path(step_cost, offered, known, deadline=deadline)
    curves = path.curves
    radii = [box.reach(len(first)) for box, first in zip(boxes, firsts, strict=True)]
    # A search of more variables converges later.
    rounds = min(max(_LEAST_ROUNDS, sum(map(len, axes)) + 8), _MOST_ROUNDS)
    for number in range(rounds):
        if not path.complete:
            break
        centers = path.values
        windows = [
            box.around(center, radius, number)
            for box, center, radius in zip(boxes, centers, radii, strict=True)
        ]
        path = least_path(step_cost, windows, centers, deadline=deadline)
        radii = [
            np.maximum(_SHRINKS * radius, _REACH * box.apart(center, value))
            for box, radius, center, value in zip(boxes, radii, centers, path.values, strict=True)
        ]
    return Optimum(path.values, path.cost, curves, path.complete)


def _count(axes: Sequence[Sequence[Range]], index: int) -> int:
    """Return the number of first candidates of a subgoal."""
    free = len(axes[index])
    beside = max((len(axes[i]) for i in (index - 1, index + 1) if 0 <= i < len(axes)), default=0)
    if not beside:
        return _BOX_ALONE
    size = _BOX_FIRST[min(free, len(_BOX_FIRST) - 1)]
    return min(size, _BOX_BESIDE) if free > 2 and beside > 2 else size


def _joined(first: FloatArray, others: FloatArray) -> FloatArray:
    """Return candidates (n, k) that begin with one of shape (k,); where k is 0 there is only one."""
    return np.vstack([first, others]) if len(first) else others


class _Box:
    """The domains of one subgoal's free variables, and its region."""

    def __init__(self, index: int, domains: Sequence[Range], allowed: Allowed | None) -> None:
        self.index, self._domains, self._allowed = index, domains, allowed
        self._low = np.array([domain.low for domain in domains])
        self._span = np.array([domain.high for domain in domains]) - self._low
        self._period = np.array([_period(domain) for domain in domains])

    def reach(self, count: int) -> FloatArray:
        """Return half the distance between `count` evenly spread candidates in each variable, shape (k,)."""
        return np.asarray(self._span * 0.5 * max(count, 1) ** (-1.0 / max(len(self._domains), 1)))

    def spread(self, count: int) -> FloatArray:
        """Return up to `count` candidates, shape (n, k), spread evenly over the allowed region."""
        if not self._domains:
            return np.zeros((1, 0))
        tries = count if self._allowed is None else count * _TRIES
        points = self._low + self._span * spread_points(len(self._domains), 0, tries)
        return self._within(points)[:count]

    def around(self, center: FloatArray, radius: FloatArray, number: int) -> FloatArray:
        """Return `center` (k,) and candidates of the box of half width `radius` (k,) around it, (n, k).

        Each round, counted from 0, has other candidates.
        """
        free = len(center)
        if not free:
            return np.zeros((1, 0))
        count = _BOX_AROUND[min(free, len(_BOX_AROUND) - 1)]
        points = center + radius * (2.0 * spread_points(free, number * count, count) - 1.0)
        into_domains(points, self._domains)
        return _joined(center, self._within(points))

    def apart(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the distance between two candidates in each variable, shapes (k,)."""
        distance = np.abs(end - start) % self._period  # given values may be turns away
        return np.asarray(np.minimum(distance, self._period - distance))

    def _within(self, points: FloatArray) -> FloatArray:
        return points if self._allowed is None else points[self._allowed(self.index, points)]


def into_domains(points: FloatArray, domains: Sequence[Range]) -> None:
    """Bring values (n, k) into their domains: angles by whole turns, others to the bound."""
    for column, domain in enumerate(domains):
        values, period = points[:, column], _period(domain)
        if np.isfinite(period):
            points[:, column] = (values - domain.low) % period + domain.low
        else:
            points[:, column] = np.clip(values, domain.low, domain.high)


def _period(domain: Range) -> float:
    """Return the period of a domain; infinite if it has none, or only one value."""
    width = domain.high - domain.low
    return width if domain.periodic and width > 0.0 else np.inf


def spread_points(dimensions: int, first: int, count: int) -> FloatArray:
    """Return `count` points of the unit cube, shape (n, k), of a sequence that fills it evenly.

    It adds powers of the inverse of the generalized golden ratio (M. Roberts, 2018).
    """
    return _sequence(dimensions)[first : first + count]


@lru_cache(maxsize=8)
def _sequence(dimensions: int) -> FloatArray:
    ratio = 2.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = (1.0 / ratio) ** np.arange(1, dimensions + 1)
    points: FloatArray = (0.5 + np.arange(_POINTS)[:, None] * steps) % 1.0
    points.setflags(write=False)
    return points
