"""The search where a subgoal has more than two free variables: too many for a grid.

The first candidates of each subgoal are spread evenly over its domains, as far as its region allows. The best
chain through them is found as on a grid, and then again, round by round, among candidates in boxes around the
best. A box shrinks in each variable in which the best hardly moves; in one in which it moves, the box remains
wide enough to move on. Nothing is random: the same request has the same answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.refinement.paths import Optimum, SearchCurve, StepCost, least_path
from ator_ros.refinement.slices import Slices
from ator_ros.tops.ranges import Range

Allowed = Callable[[int, FloatArray], BoolArray]
"""Returns which candidates (n, k) of a subgoal its region allows, shape (n,)."""

FIRST = (1, 16, 12, 64, 150)
"""First candidates of a subgoal with so many free variables."""
AROUND = (1, 5, 6, 16, 24)
"""The same of a box."""
ALONE = 400
"""The same where the neighbours are fixed."""
MOST_BESIDE = 48
"""First candidates of a subgoal with more than two free variables beside another such one."""
LEAST_ROUNDS, MOST_ROUNDS = 14, 20
"""Rounds for up to six free variables in all, and for twelve or more."""
SHRINKS = 0.75
"""What is left of the width of a box after a round, at least."""
REACH = 2.0
"""Half the width of a box, at least, in distances that the best has moved in the round before."""
_TRIES = 40  # points that are looked at for each candidate wanted, of _POINTS
_POINTS = 1 << 13


class NoCandidateError(ValueError):
    """None of the points that are looked at lies within what is allowed, and nothing is given."""


def sampling(
    step_cost: StepCost,
    axes: Sequence[Sequence[Range]],
    given: Sequence[FloatArray] | None,
    allowed: Allowed | None,
) -> Slices[Optimum]:
    """Search in slices, as `ator_ros.refinement.search.searching` does."""
    boxes = [_Box(index, domains, allowed) for index, domains in enumerate(axes)]
    firsts = [box.spread(_count(axes, box.index)) for box in boxes]
    if given is None and not all(map(len, firsts)):
        raise NoCandidateError("expected candidates of every subgoal, got none")
    known = [] if given is None else list(given)
    offered = [_joined(v, first) for v, first in zip(known, firsts, strict=True)] if known else firsts
    path = yield from least_path(step_cost, offered, known)
    curves = tuple(map(SearchCurve, path.candidates, path.totals))
    radii = [box.reach(len(first)) for box, first in zip(boxes, firsts, strict=True)]
    for number in range(_rounds(axes)):
        if not path.complete:
            break
        yield
        centres = path.values
        windows = [
            box.around(centre, radius, number)
            for box, centre, radius in zip(boxes, centres, radii, strict=True)
        ]
        path = yield from least_path(step_cost, windows, centres)
        radii = [
            np.maximum(SHRINKS * radius, REACH * box.apart(centre, value))
            for box, radius, centre, value in zip(boxes, radii, centres, path.values, strict=True)
        ]
    return Optimum(tuple(path.values), path.cost, curves, path.complete)


def _rounds(axes: Sequence[Sequence[Range]]) -> int:
    """Return in how many rounds a search ends: what has more variables takes longer to arrive."""
    free = sum(map(len, axes))
    return min(max(LEAST_ROUNDS, free + 8), MOST_ROUNDS)


def _count(axes: Sequence[Sequence[Range]], index: int) -> int:
    """Return how many first candidates a subgoal has."""
    free = len(axes[index])
    beside = max((len(axes[i]) for i in (index - 1, index + 1) if 0 <= i < len(axes)), default=0)
    if not beside:
        return ALONE
    size = FIRST[min(free, len(FIRST) - 1)]
    return min(size, MOST_BESIDE) if free > 2 and beside > 2 else size


def _joined(first: FloatArray, others: FloatArray) -> FloatArray:
    """Return candidates (n, k) that begin with one of shape (k,); where k is 0 there is but one anyway."""
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
        """Return up to `count` candidates, shape (n, k), spread evenly over what is allowed."""
        if not self._domains:
            return np.zeros((1, 0))
        tries = count if self._allowed is None else count * _TRIES
        points = self._low + self._span * spread_points(len(self._domains), 0, tries)
        return self._within(points)[:count]

    def around(self, centre: FloatArray, radius: FloatArray, number: int) -> FloatArray:
        """Return `centre` (k,) and candidates of the box of half width `radius` (k,) around it, (n, k).

        The candidates are others in each round, whose `number` counts from 0.
        """
        free = len(centre)
        if not free:
            return np.zeros((1, 0))
        count = AROUND[min(free, len(AROUND) - 1)]
        points = centre + radius * (2.0 * spread_points(free, number * count, count) - 1.0)
        into_domains(points, self._domains)
        return _joined(centre, self._within(points))

    def apart(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the distance between two candidates in each variable, shapes (k,)."""
        distance = np.abs(end - start) % self._period  # what is given may be turns away
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
    """Return after what the values of a domain repeat; infinite where they do not, or there is but one."""
    width = domain.high - domain.low
    return width if domain.periodic and width > 0.0 else np.inf


def spread_points(dimensions: int, first: int, count: int) -> FloatArray:
    """Return `count` points of the unit cube, shape (n, k), of a sequence that fills it evenly.

    It adds powers of the inverse of the generalised golden ratio (M. Roberts, 2018).
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
