"""The search for the best subgoals of a whole chain (paper, section 4.3, for any number of variables).

Dynamic programming finds the best chain through a grid of candidates for every subgoal. The grid is
exhaustive where one variable is free. Otherwise it is coarse, and the subgoals of the best chain are then
placed exactly, one after the other (`ator_ros.refinement.sweeps`). Where a subgoal has more than two free
variables, or its candidates are bounded by a region, candidates are spread evenly instead
(`ator_ros.refinement.sampled`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.refinement.averaging import Averages
from ator_ros.refinement.candidates import with_candidate
from ator_ros.refinement.paths import Optimum, SearchCurve, StepCost, best_apart, least_path
from ator_ros.refinement.sampled import Allowed, into_domains, sampling
from ator_ros.refinement.slices import Slices, completed
from ator_ros.refinement.sweeps import sweeping
from ator_ros.tops.ranges import Range

SINGLE = 120
"""Candidates for one free variable on its own: 3 degrees of an angle. Nothing finer is searched then."""
ALONE = 432
"""First candidates of a subgoal with several free variables whose neighbours are fixed."""
PAIRED = 24
"""The same of a subgoal whose neighbour has free variables too: all pairs of both are searched."""
LEAST_STEPS = 3
ROUNDS = 4
"""How often such subgoals are placed anew, each time in windows half as wide."""
ZOOM_STEPS = (9, 5)
"""Steps of a window in each direction, for one and two free variables."""
ZOOM_WINDOWS = 2
"""In the first round, around so many of the best candidates."""
MOST_ON_GRID = 2
"""Free variables of a subgoal that are searched on a grid."""


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
    step_cost: StepCost,
    axes: Sequence[Sequence[Range]],
    given: Sequence[FloatArray] | None = None,
    allowed: Allowed | None = None,
    averages: Averages | None = None,
) -> Slices[Optimum]:
    """Search as `search` does, in slices; when time is up, subgoals not yet searched keep what is `given`.

    Without given values, all of the first candidates are searched nevertheless. Candidates are limited to
    what is `allowed`; what is given is searched in any case. With `averages` a candidate is compared by the
    mean over its neighbours on the grid where that is more than its own cost; candidates that are spread
    evenly have none.
    """
    if allowed is not None or max(map(len, axes)) > MOST_ON_GRID:
        return (yield from sampling(step_cost, axes, given, allowed))
    grids, steps = _first_grids(tuple(map(tuple, axes)))
    known = list(given) if given is not None else []
    candidates = [with_candidate(*each) for each in zip(grids, known, strict=True)] if known else grids
    first = yield from least_path(step_cost, candidates, known, averages)
    curves = tuple(
        SearchCurve(grid, total[: len(grid)]) if searched is offered else SearchCurve(searched, total)
        for grid, offered, searched, total in zip(
            grids, candidates, first.candidates, first.totals, strict=True
        )
    )
    if sum(len(domains) for domains in axes) <= 1 or not first.complete:
        return Optimum(tuple(first.values), first.cost, curves, first.complete, first.given)
    centres = [
        best_apart(offered, total, step, most=ZOOM_WINDOWS) if domains else []
        for offered, total, step, domains in zip(candidates, first.totals, steps, axes, strict=True)
    ]

    def window(index: int, value: FloatArray, number: int) -> FloatArray:
        around, step = (centres[index] if number == 0 else [value]), steps[index] * 0.5**number
        return _distinct(np.vstack([value, *(_window(centre, step, axes[index]) for centre in around)]))

    rounds = ROUNDS if any(axes[i] and axes[i + 1] for i in range(len(axes) - 1)) else 1
    values, cost, complete = yield from sweeping(step_cost, first, window, rounds, averages)
    return Optimum(tuple(values), cost, curves, complete, first.given)


def unsearched(given: Sequence[FloatArray], cost: float) -> Optimum:
    """Return what is known without any search: the values of each subgoal, shapes (k,), and their cost."""
    curves = tuple(SearchCurve(values[None, :], np.array([cost])) for values in given)
    return Optimum(tuple(given), cost, curves, complete=False)


@lru_cache(maxsize=32)
def _first_grids(axes: tuple[tuple[Range, ...], ...]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return for each subgoal the first candidates, shape (n, k), and their distances, shape (k,).

    Plans are repeated, so grids are kept; they must not be written to.
    """
    grids, steps = [], []
    for index, domains in enumerate(axes):
        neighbours = [axes[i] for i in (index - 1, index + 1) if 0 <= i < len(axes)]
        budget = PAIRED if any(neighbours) else SINGLE if len(domains) == 1 else ALONE
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


def _distinct(candidates: FloatArray) -> FloatArray:
    """Return `candidates` (n, k), each once: windows overlap, and at a bound much of one falls together."""
    return np.array(list(dict.fromkeys(map(tuple, candidates.tolist()))))


def _product(lines: Sequence[FloatArray]) -> FloatArray:
    """Return all combinations, shape (n, k), of the values on k lines; (1, 0) for none."""
    if not lines:
        return np.zeros((1, 0))
    return np.stack([axis.ravel() for axis in np.meshgrid(*lines, indexing="ij")], axis=1)


def _window(centre: FloatArray, step: FloatArray, domains: Sequence[Range]) -> FloatArray:
    """Return candidates, shape (n, k), that divide the steps of the first grid around `centre`."""
    count = ZOOM_STEPS[len(domains) - 1]
    window = _product([c + s * np.linspace(-1.0, 1.0, count) for c, s in zip(centre, step, strict=True)])
    into_domains(window, domains)
    return window
