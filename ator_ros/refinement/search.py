"""The search for the best subgoals of a whole chain (paper, section 4.3, for any variables).

The cost of a chain is a sum of terms, each of which depends on two neighboring subgoals only.
Dynamic programming therefore finds the best path through sets of candidates exactly, one set for
each subgoal, with every term evaluated once for each pair and vectorized.

The first sets cover the domains. The later ones are windows around the best candidates, and shrink
from round to round. Neighboring subgoals take turns: one has windows while the other has its best
candidates only, as pairs of windows would cost more than they gain. Nothing is random: the same
request has the same answer.

The caller passes a `Deadline`, which is checked between blocks of candidates. Once time is up, the
subgoals that have not been searched keep their values. `Work` estimates how much is left.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.tops.ranges import Range

Pairs = tuple[int, FloatArray, FloatArray]
"""Index of a step, and candidates of the subgoals around it, shapes (n, 1, k) and (m, k)."""
StepCosts = Callable[[Sequence[Pairs]], Sequence[FloatArray]]
"""Returns the costs of steps for all pairs of candidates, shapes that broadcast to (n, m)."""
Allowed = Callable[[int, FloatArray], BoolArray]
"""Returns which candidates (n, k) of a subgoal its region allows, shape (n,)."""
Deadline = Callable[[], bool]
"""Returns whether time is up."""

BLOCK = 512
"""Pairs of candidates evaluated between two checks of the deadline: 1 to 2 ms as shipped."""

# Numbers of candidates by the number of a subgoal's free variables, from 0; the last entry is for
# all that have more. benchmarks/search.py compares what the search finds with them to references.
_FIRST_ALONE = (1, 40, 108, 256, 400)  # first candidates: 9 degrees of an angle
_FIRST_BESIDE = (1, 30, 24, 36, 48)  # beside another free subgoal: all pairs are evaluated
_IN_WINDOW = (0, 6, 10, 15, 20)  # candidates of a window, besides its center
_ROUNDS = 4  # most rounds for each free variable of a subgoal: more variables need more moves
_ON_GRID = 2  # free variables up to which the first candidates form a grid, with ends of ranges
_LEAST_STEPS = 3  # of a grid in each direction
_APART = 0.5  # least distance between the two candidates that have windows, in half widths
_GAIN = 1e-3  # least gain of a round, as a share of the mean cost of a step: 5 ms of 5 s
_SHRINKS = 0.5  # least factor by which a window shrinks in a round
_REACH = 2.0  # least half width of a window in last moves: windows follow a bent valley
_TRIES = 40  # points tested for each candidate in a region, of _POINTS
_POINTS = 1 << 13
_NOT_KNOWN = np.empty((0, 0))
_CALL = 40  # pairs that take as long as a call without pairs: 60 us, and 1.5 us, as shipped


class NoCandidateError(ValueError):
    """No tested point lies in the allowed region, and no values are given."""


def no_deadline() -> bool:
    """Return False: a deadline that never passes."""
    return False


@dataclass(slots=True)
class Work:
    """How much of a search is done, in evaluated pairs of candidates.

    Attributes
    ----------
    done, expected : float
        What has been evaluated, and an estimate of the whole that is rather too large.
    """

    done: float = 0.0
    expected: float = 0.0

    def add(self, pairs: int) -> None:
        """Count the evaluation of a block of pairs."""
        self.done += pairs + _CALL


def expected_work(axes: Sequence[Sequence[Range]]) -> float:
    """Return an estimate of the work of `search` with these axes, which is rather too large."""
    free = [0, *map(len, axes), 0]
    grid_sizes = [1]
    window_sizes = [1]
    for index, count in enumerate(free[1:-1], 1):
        table = _FIRST_BESIDE if free[index - 1] or free[index + 1] else _FIRST_ALONE
        grid_sizes.append(1 + _of(table, count) if count else 1)
        window_sizes.append(2 * (1 + _of(_IN_WINDOW, count)) if count else 1)
    pairs_of_grids = sum(before * after for before, after in itertools.pairwise(grid_sizes))
    larger = (max(pair) for pair in itertools.pairwise(window_sizes))
    # of two neighbors one has its best two candidates only
    pairs_per_round = sum(2 * size for size in larger if size > 1)
    most_rounds = _turns(free) * _ROUNDS * max(free)
    return _work(pairs_of_grids) + most_rounds * _work(pairs_per_round)


def _work(pairs: int) -> float:
    """Return the work of evaluating pairs in blocks."""
    return pairs + _CALL * math.ceil(pairs / BLOCK)


def _turns(free: Sequence[int]) -> int:
    """Return in how many turns the subgoals have windows: 2 if any two neighbors are free."""
    return 2 if any(map(all, itertools.pairwise(free))) else 1


class SearchCurve(NamedTuple):
    """The candidates of one subgoal.

    Attributes
    ----------
    values : ndarray, shape (n, k)
        Candidates: values of the subgoal's k free variables.
    totals : ndarray, shape (n,)
        Cost of the whole chain with each candidate and the best values of the other subgoals.
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
    rows : sequence of int
        Row of the best candidate among the last ones of each subgoal.
    costs : sequence of ndarray, shapes (n, m)
        Cost of each step with the last candidates of the subgoals before (n) and after it (m).
    first_costs : sequence of ndarray, shapes (n, m)
        The same with the first candidates, without the given values; empty if not all are known.
    complete : bool
        False if the deadline ended the search.
    """

    values: Sequence[FloatArray]
    cost: float
    curves: Sequence[SearchCurve]
    rows: Sequence[int] = ()
    costs: Sequence[FloatArray] = ()
    first_costs: Sequence[FloatArray] = ()
    complete: bool = True

    @property
    def searched(self) -> bool:
        """Whether any candidate besides the given values was evaluated."""
        return any(len(curve.values) > 1 for curve in self.curves)


def search(
    step_costs: StepCosts,
    axes: Sequence[Sequence[Range]],
    given: Sequence[FloatArray] | None = None,
    *,
    allowed: Allowed | None = None,
    first_costs: Sequence[FloatArray] = (),
    deadline: Deadline = no_deadline,
    work: Work | None = None,
) -> Optimum:
    """Find the values of all free variables with the least cost of the whole chain.

    Raises NoCandidateError if no tested point is allowed, and no values are given.

    Parameters
    ----------
    step_costs : callable
        Step 0 starts from an array (1, 1, 0).
    axes : sequence, one item per subgoal
        Domains of the subgoal's free variables; empty where none is free.
    given : sequence, one item per subgoal, optional
        Values of each subgoal, shape (k,), that are among the candidates, so that the result is
        never worse.
    allowed : callable, optional
        Limits the candidates, but for given values.
    first_costs : sequence of ndarray, optional
        Those of another search that differs in the given values only.
    deadline : callable, optional
        Once it has passed, subgoals that have not been searched keep their given values. Without
        given values, all first candidates are evaluated nevertheless.
    work : Work, optional
        Counts what is evaluated.
    """
    if work is not None:
        step_costs = _counted(step_costs, work)
    free = [0, *map(len, axes), 0]
    windows = []
    for index, domains in enumerate(axes):
        beside = free[index] > 0 or free[index + 2] > 0
        windows.append(_Windows(index, domains, allowed, beside=beside))
    candidates = [window.first for window in windows]
    if given is not None:
        for index, values in enumerate(given):
            if len(values):
                candidates[index] = np.vstack((values, candidates[index]))
    elif not all(map(len, candidates)):
        raise NoCandidateError("expected candidates of every subgoal, got none")
    of_first = deadline if given is not None else no_deadline
    path = least_path(step_costs, candidates, of_first, first_costs)
    curves = path.curves
    if path.complete:
        first_costs = _last_costs(path.costs, [len(window.first) for window in windows])
    cycle = _turns(free) * max(free)  # most valleys are narrow in one variable only
    without_gain = 0
    for number in range(cycle * _ROUNDS):
        if without_gain == cycle:
            break
        if not path.complete or deadline():
            return dataclasses.replace(path, curves=curves, first_costs=first_costs, complete=False)
        candidates = []
        known = []  # costs between subgoals that keep their candidates
        rows_before = [0]
        kept_before = True
        for index, window in enumerate(windows):
            curve = path.curves[index]
            best = window.best(path.rows[index], curve)
            centers = curve.values.take(best, axis=0)
            kept = not window.has_new(number)
            if kept and kept_before:
                costs = path.costs[index].take(rows_before, axis=0)
                known.append(costs.take(best, axis=1))
            else:
                known.append(_NOT_KNOWN)
            candidates.append(centers if kept else window.around(centers, number))
            rows_before = best
            kept_before = kept
        former = path
        path = least_path(step_costs, candidates, deadline, known)
        for window, start, end in zip(windows, former.values, path.values, strict=True):
            window.shrink(start, end, number)
        gains = former.cost - path.cost > _GAIN * abs(former.cost) / len(axes)
        without_gain = 0 if gains else without_gain + 1
    return dataclasses.replace(path, curves=curves, first_costs=first_costs)


def _last_costs(costs: Sequence[FloatArray], counts: Sequence[int]) -> list[FloatArray]:
    """Return the costs of each step between so many of the last candidates of each subgoal."""
    found = []
    for cost, last in zip(costs, itertools.pairwise((1, *counts)), strict=True):
        row, column = np.subtract(cost.shape, last).tolist()
        found.append(cost[row:, column:])
    return found


def _counted(step_costs: StepCosts, work: Work) -> StepCosts:
    def counted(steps: Sequence[Pairs]) -> Sequence[FloatArray]:
        costs = step_costs(steps)
        work.add(sum(cost.size for cost in costs))
        return costs

    return counted


def unsearched(given: Sequence[FloatArray], cost: float) -> Optimum:
    """Return the result of no search: the values of each subgoal, shapes (k,), and their cost."""
    curves = [SearchCurve(values[None, :], np.array([cost])) for values in given]
    return Optimum(given, cost, curves, complete=False)


# Dynamic programming


def least_path(
    step_costs: StepCosts,
    candidates: Sequence[FloatArray],
    deadline: Deadline = no_deadline,
    known: Sequence[FloatArray] = (),
) -> Optimum:
    """Find the best candidate of each subgoal; after the deadline, later ones keep the first.

    `known` are the costs (n, m) of each step with the last n and m candidates; the others are
    evaluated, by default all.
    """
    unknown = [_NOT_KNOWN] * len(candidates)
    costs = _evaluated(step_costs, candidates, known or unknown, deadline)
    in_time = len(costs)
    if in_time < len(candidates):
        first_only = [each[:1] for each in candidates[in_time:]]
        candidates = [*candidates[:in_time], *first_only]
        known = [*costs, *unknown[in_time:]]
        costs = _evaluated(step_costs, candidates, known, no_deadline)
    forward = [costs[0][0]]
    origins = []
    for cost in costs[1:]:
        sums = forward[-1][:, None] + cost
        origins.append(sums.argmin(axis=0))
        forward.append(sums.min(axis=0))
    backward = [np.zeros(len(candidates[-1]))]
    for cost in reversed(costs[1:]):
        backward.insert(0, (cost + backward[0]).min(axis=1))
    row = int(forward[-1].argmin())
    total = float(forward[-1][row])
    rows = [row]
    for origin in reversed(origins):
        rows.insert(0, int(origin[rows[0]]))
    values = []
    curves = []
    for index, among in enumerate(candidates):
        values.append(among[rows[index]])
        curves.append(SearchCurve(among, forward[index] + backward[index]))
    is_complete = in_time == len(candidates)
    return Optimum(values, total, curves, rows, costs, complete=is_complete)


def _evaluated(
    evaluate: StepCosts,
    candidates: Sequence[FloatArray],
    known: Sequence[FloatArray],
    deadline: Deadline,
) -> list[FloatArray]:
    """Return the costs (n, m) of each step, evaluated if not known; of fewer if time is up."""
    costs: list[FloatArray] = []
    blocks: list[tuple[list[Pairs], list[FloatArray]]] = []  # pairs, and their parts of the costs
    room = 0  # pairs for which the last block has room
    before = np.zeros((1, 0))
    for index, after in enumerate(candidates):
        cost = np.empty((len(before), len(after)))
        new_rows, new_columns = np.subtract(cost.shape, known[index].shape).tolist()
        cost[new_rows:, new_columns:] = known[index]
        costs.append(cost)
        unknown = [
            (cost[:new_rows], before[:new_rows], after),
            (cost[new_rows:, :new_columns], before[new_rows:], after[:new_columns]),
        ]
        for part, befores, afters in unknown:
            rows = max(1, BLOCK // max(1, len(afters)))
            for first in range(0, len(befores) if part.size else 0, rows):
                result = part[first : first + rows]
                room -= result.size
                if room < 0:
                    blocks.append(([], []))
                    room = BLOCK - result.size
                pairs, results = blocks[-1]
                pairs.append((index, befores[first : first + rows, None], afters))
                results.append(result)
        before = after
    for pairs, results in blocks:
        if deadline():
            return costs[: pairs[0][0]]
        for result, values in zip(results, evaluate(pairs), strict=True):
            result[:] = values
    return costs


# Candidates


class _Windows:
    """The candidates of one subgoal: the first ones (n, k), and shrinking windows around the best.

    `ranges` are those of its k free variables, `allowed` limits the candidates to its region, and
    `beside` is whether a neighboring subgoal has free variables.
    """

    def __init__(
        self,
        index: int,
        ranges: Sequence[Range],
        allowed: Allowed | None,
        *,
        beside: bool,
    ) -> None:
        self._index = index
        self._ranges = ranges
        self._allowed = allowed
        self._beside = beside
        self._low = np.array([each.low for each in ranges], dtype=float)
        self._high = np.array([each.high for each in ranges], dtype=float)
        circles = [each.periodic and each.high > each.low for each in ranges]
        is_circle = np.array(circles, dtype=bool)
        self._period = np.where(is_circle, self._high - self._low, np.inf)
        self._bounds = np.stack((self._low, self._high, self._period))
        self._used = 0  # points of the sequence
        self.first, self._radius = self._first()

    def best(self, row: int, curve: SearchCurve) -> list[int]:
        """Return `row`, and the best row that is no neighbor of it: its valley may be deeper."""
        reach = _APART * self._radius
        second = _best_apart(curve.values, curve.totals, row, reach, self._period)
        return [row, second] if second >= 0 else [row]

    def around(self, centers: FloatArray, number: int) -> FloatArray:
        """Return the `centers` (n, k), and new candidates in windows around them."""
        each = _of(_IN_WINDOW, len(self._ranges))
        points = spread_points(len(self._ranges), self._used, each * len(centers))
        self._used += len(points)
        points = _in_windows(points, centers, each, self._radius, self._bounds, number)
        return np.concatenate((centers, self._within(points)))

    def shrink(
        self,
        start: FloatArray,
        end: FloatArray,
        number: int,
    ) -> None:
        """Shrink the windows after a round that moved the best candidate from `start` to `end`."""
        if self.has_new(number):
            distance = np.abs(end - start) % self._period  # given values may be turns away
            moved = np.minimum(distance, self._period - distance)
            self._radius = np.maximum(_SHRINKS * self._radius, _REACH * moved)

    def has_new(self, number: int) -> bool:
        """Return whether the subgoal has new candidates in a round."""
        return bool(self._ranges) and (not self._beside or (self._index + number) % 2 == 0)

    def _first(self) -> tuple[FloatArray, FloatArray]:
        count = _of(_FIRST_BESIDE if self._beside else _FIRST_ALONE, len(self._ranges))
        return first_candidates(self._index, self._ranges, count, self._allowed)

    def _within(self, points: FloatArray) -> FloatArray:
        """Return the points moved to allowed parts of their ranges, and in the allowed region."""
        for column, domain in enumerate(self._ranges):
            if domain.parts:
                points[:, column] = domain.nearest(points[:, column])
        return points if self._allowed is None else points[self._allowed(self._index, points)]


def first_candidates(
    index: int,
    ranges: Sequence[Range],
    count: int,
    allowed: Allowed | None,
) -> tuple[FloatArray, FloatArray]:
    """Return about `count` candidates of a subgoal that cover its ranges.

    Returns
    -------
    candidates : ndarray, shape (n, k)
        Fewer in a small region, none if no tested point is allowed.
    widths : ndarray, shape (k,)
        How far apart they are in each variable, which is half the width of a window around one.
    """
    free = len(ranges)
    if free <= _ON_GRID:
        grid, steps = _grid(tuple(ranges), count)
        if allowed is None or allowed(index, grid).all():
            return grid.copy(), steps
    points = spread_over(ranges, count if allowed is None else count * _TRIES)
    if allowed is not None:
        points = points[allowed(index, points)]
    points = points[:count]
    widths = np.array([each.width for each in ranges], dtype=float)
    return points, 0.5 * widths * max(len(points), 1) ** (-1.0 / free)


def spread_over(ranges: Sequence[Range], count: int) -> FloatArray:
    """Return `count` points, shape (n, k), that cover ranges evenly; see `spread_points`."""
    points = spread_points(len(ranges), 0, count)
    columns = [each.spread(column) for each, column in zip(ranges, points.T, strict=True)]
    return np.stack(columns, axis=1)


@lru_cache(maxsize=32)
def _grid(domains: tuple[Range, ...], count: int) -> tuple[FloatArray, FloatArray]:
    """Return about `count` candidates that form a grid, (n, k), and its steps, (k,)."""
    lines: dict[int, FloatArray] = {}
    widths: dict[int, float] = {}
    numbers = range(len(domains))
    for number in sorted(numbers, key=lambda each: domains[each].steps):  # the coarsest first
        domain = domains[number]
        others = [domains[each].steps for each in numbers if each not in lines]
        left = count / math.prod(len(line) for line in lines.values())
        scale = (left / math.prod(others)) ** (1.0 / len(others))
        steps = max(_LEAST_STEPS, round(domain.steps * scale))
        lines[number], widths[number] = domain.grid(steps)
    if not domains:
        return np.zeros((1, 0)), np.zeros(0)
    axes = np.meshgrid(*(lines[number] for number in numbers), indexing="ij")
    # The last variable, usually a speed, varies slowest: path times take longer where it changes.
    grid = np.stack([axis.ravel("F") for axis in axes], axis=1)
    return grid, np.array([widths[number] for number in numbers])


def _of(table: Sequence[int], free: int) -> int:
    """Return the entry for so many free variables."""
    return table[min(free, len(table) - 1)]


@compiled
def _in_windows(
    points: FloatArray,
    centers: FloatArray,
    each: int,
    radius: FloatArray,
    bounds: FloatArray,
    number: int,
) -> FloatArray:
    """Return points (n, k) of the unit cube moved to windows, `each` of them to one center."""
    low, high, period = bounds
    moved = np.empty(points.shape)
    for row, column in np.ndindex(points.shape):
        # Every second candidate differs in one variable only: a variable that is aligned exactly,
        # or at the end of its range, remains so while another one changes.
        differs = row % 2 == 1 or column == (row // 2 + number) % len(radius)
        offset = 2.0 * points[row, column] - 1.0 if differs else 0.0
        value = centers[row // each, column] + radius[column] * offset
        if period[column] < np.inf:
            moved[row, column] = (value - low[column]) % period[column] + low[column]
        else:
            moved[row, column] = min(max(value, low[column]), high[column])
    return moved


@compiled
def _best_apart(
    values: FloatArray,
    totals: FloatArray,
    row: int,
    reach: FloatArray,
    period: FloatArray,
) -> int:
    """Return the row of the best candidate (n, k) beyond `reach` (k,) of candidate `row`.

    -1 if none is.
    """
    found = -1
    least = np.inf
    for number in range(len(values)):
        if totals[number] < least:
            for column in range(len(reach)):
                distance = abs(values[number, column] - values[row, column]) % period[column]
                if min(distance, period[column] - distance) >= reach[column]:
                    found = number
                    least = totals[number]
                    break
    return found


def spread_points(
    dimensions: int,
    first: int,
    count: int,
) -> FloatArray:
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
