"""The best subgoals that are found without regard to time: by brute force, and by a global optimiser."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.optimize import differential_evolution

from ator_ros.evaluation.policies import Toolset
from ator_ros.evaluation.trials import Trial
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.refinement.chain_prediction import ChainModel
from ator_ros.refinement.free_variables import names_of
from ator_ros.refinement.objective import expected_time
from ator_ros.refinement.refiner import replaced
from ator_ros.refinement.search import Allowed, least_path
from ator_ros.tops.chain import TopChain
from ator_ros.tops.ranges import Range

SPEED_STEP = 0.05
"""Distance in m/s between fine candidates, for each degree between those of an angle."""
POPULATION, GENERATIONS = 32, 400
"""Of the optimiser: individuals for each variable (in all rounded up to a power of two), and generations."""
_OUTSIDE = 1000.0  # cost in s of what a region does not allow


class Reference:
    """The cost of one chain, and what is open in it.

    Parameters
    ----------
    tools, trial
        Models and the world.
    chain : TopChain
        What is compared with; where nothing better is found it is returned.
    """

    def __init__(self, tools: Toolset, trial: Trial, chain: TopChain) -> None:
        refiner = tools.refiner(gated=True)
        analysis, regions = refiner.bounded(trial.world, chain)
        self._chain, self._allowed = chain, regions.allowing()
        self._model = ChainModel(
            trial.world, chain, tools.robot, models=refiner.models, names=names_of(chain, analysis.free),
            objective=expected_time(refiner.failure_cost),
        )  # fmt: skip
        self._axes = [
            [each.domain for each in analysis.free if each.subgoal == index]
            for index in range(len(chain.calls))
        ]
        self._names = names_of(chain, analysis.free)

    def brute_force(self, degrees: int) -> TopChain:
        """Return the best of all chains on a fine grid with so many degrees between angles."""
        grids = []
        for given, axes in zip(self._model.given, self._axes, strict=True):
            lines = [fine_line(domain, degrees) for domain in axes]
            grid = np.array(list(itertools.product(*lines)), dtype=float)
            grids.append(np.vstack([given, grid]) if lines else grid)
        return self._with(least_path(self._model.step_cost, grids, self._model.given).values)

    def optimised(self, seed: int) -> TopChain:
        """Return what a long run of differential evolution finds (Storn and Price 1997, SciPy)."""
        bounds = [(domain.low, domain.high) for axes in self._axes for domain in axes]
        found = differential_evolution(
            self._costs, bounds, vectorized=True, updating="deferred", init="sobol", popsize=POPULATION,
            maxiter=GENERATIONS, tol=0.0, polish=False, seed=seed,
        )  # fmt: skip
        given = np.concatenate(self._model.given)
        best = found.x if found.fun < self._costs(given[:, None])[0] else given
        return self._with([values[0] for values in self._split(best[:, None])])

    def _costs(self, points: FloatArray) -> FloatArray:
        """Return the cost of chains with free values `points` (variables, n), shape (n,)."""
        subgoals = self._split(points)
        cost, before = np.zeros(points.shape[1]), np.zeros((1, 0))
        for step, after in enumerate(subgoals):
            cost = cost + self._model.step_cost(step, before, after)
            before = after
        cost[~_allowed(self._allowed, subgoals, points.shape[1])] = _OUTSIDE
        return np.fmin(cost, _OUTSIDE)

    def _split(self, points: FloatArray) -> list[FloatArray]:
        """Return the values of each subgoal, shapes (n, k), or (1, 0) where nothing is free."""
        ends = np.cumsum([len(axes) for axes in self._axes])[:-1]
        parts = np.split(points, ends)
        return [part.T if len(part) else np.zeros((1, 0)) for part in parts]

    def _with(self, values: Sequence[FloatArray]) -> TopChain:
        chain = self._chain
        for index, names in enumerate(self._names):
            chain = replaced(chain, index, dict(zip(names, map(float, values[index]), strict=True)))
        return chain


def fine_line(domain: Range, degrees: int) -> FloatArray:
    """Return the fine candidates of one variable; speeds are as much coarser as angles are."""
    if domain.periodic:
        return np.linspace(domain.low, domain.high, 360 // degrees, endpoint=False)
    count = max(2, round((domain.high - domain.low) / (SPEED_STEP * degrees)) + 1)
    return np.linspace(domain.low, domain.high, count)


def _allowed(allowed: Allowed | None, subgoals: Sequence[FloatArray], count: int) -> BoolArray:
    """Return which chains lie within all regions, shape (count,)."""
    inside = np.ones(count, dtype=bool)
    if allowed is not None:
        for index, values in enumerate(subgoals):
            if values.shape[1]:
                inside &= allowed(index, values)
    return inside
