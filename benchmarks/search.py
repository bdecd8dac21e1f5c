"""Compare the search of refinement with slow references, by predicted and executed durations.

    scripts/run python benchmarks/search.py --seed 2051 --situations 125

With up to three free variables the reference is brute force: every combination of a fine grid, 1
degree of each heading (2 where three are open) and 0.05 m/s (0.1) of each speed. With more it is a
global optimizer.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from ator_ros.domains.trials import Trial, open_places, open_speeds, random_trial
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.performance.accuracy import mean_ci95
from ator_ros.refinement.chain_prediction import ChainModel, predict_chain
from ator_ros.refinement.free_variables import names_of
from ator_ros.refinement.objective import expected_time
from ator_ros.refinement.refiner import replaced
from ator_ros.refinement.search import least_path
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ranges import Range

NEAR = 0.005  # relative cost above the reference up to which the search counts as near
# m/s between candidates of a speed, for each degree between candidates of an angle
SPEED_STEP = 0.05
POPULATION = 32  # individuals of the optimizer for each variable
GENERATIONS = 400  # of the optimizer
OUTSIDE = 1000.0  # cost in s of values outside a region


class Case(NamedTuple):
    """A kind of chain to search."""

    chain: int  # index of the domain's chain
    opened: Callable[[TopChain], TopChain]  # opens its variables
    degrees: int | None  # between candidates of a grid; None: a global optimizer


def _first_speed_open(chain: TopChain) -> TopChain:
    first, *others = chain.calls
    return TopChain((dataclasses.replace(first, open=first.open | {"speed"}), *others))


CASES = {
    "heading": Case(0, lambda chain: chain, 1),
    "heading and speed": Case(0, open_speeds, 1),
    "two headings": Case(-1, lambda chain: chain, 1),
    "two headings and a speed": Case(-1, _first_speed_open, 2),
    "two headings and speeds": Case(-1, open_speeds, None),
    "place, headings and speeds": Case(-1, open_places, None),
}


class Reference:
    """The cost of a chain as a function of its open variables, and its minimum."""

    def __init__(
        self,
        tools: Toolset,
        trial: Trial,
        chain: TopChain,
    ) -> None:
        refiner = tools.refiner(gated=True)
        analysis, regions = refiner.bounded(trial.world, chain)
        self._chain = chain
        self._allowed = regions.allowing()
        self._names = names_of(chain, analysis.free)
        self._model = ChainModel(
            trial.world,
            chain,
            tools.robot,
            models=refiner.models,
            names=self._names,
            objective=expected_time(refiner.failure_cost),
        )
        self._axes = []
        for index in range(len(chain.calls)):
            free = [each for each in analysis.free if each.subgoal == index]
            self._axes.append([each.domain for each in free])

    def brute_force(self, degrees: int) -> TopChain:
        """Return the best chain on a grid with this distance between angles."""
        grids = []
        for given, axes in zip(self._model.given, self._axes, strict=True):
            lines = [fine_line(domain, degrees) for domain in axes]
            grid = np.array(list(itertools.product(*lines)), dtype=float)
            grids.append(np.vstack([given, grid]) if lines else grid)
        return self._with(least_path(self._model.step_costs, grids).values)

    def optimized(self, seed: int) -> TopChain:
        """Return the chain that differential evolution finds (Storn and Price 1997, SciPy)."""
        bounds = [(domain.low, domain.high) for axes in self._axes for domain in axes]
        found = differential_evolution(
            self._costs,
            bounds,
            vectorized=True,
            updating="deferred",
            init="sobol",
            popsize=POPULATION,
            maxiter=GENERATIONS,
            tol=0.0,
            polish=False,
            seed=seed,
        )
        given = np.concatenate(self._model.given)
        best = found.x if found.fun < self._costs(given[:, None])[0] else given
        return self._with([values[0] for values in self._split(best[:, None])])

    def _costs(self, points: FloatArray) -> FloatArray:
        """Return the cost in s of chains with free values `points` (variables, n), shape (n,)."""
        subgoals = self._split(points)
        cost = np.zeros(points.shape[1])
        before = np.zeros((1, 0))
        for step, after in enumerate(subgoals):
            cost = cost + self._model.step_costs([(step, before, after)])[0]
            before = after
        cost[~self._inside(subgoals, points.shape[1])] = OUTSIDE
        return np.fmin(cost, OUTSIDE)

    def _inside(self, subgoals: Sequence[FloatArray], count: int) -> BoolArray:
        inside = np.ones(count, dtype=bool)
        for index, values in enumerate(subgoals):
            if self._allowed is not None and values.shape[1]:
                inside &= self._allowed(index, values)
        return inside

    def _split(self, points: FloatArray) -> list[FloatArray]:
        """Return the values of each subgoal, shapes (n, k), or (1, 0) if nothing is free."""
        ends = np.cumsum([len(axes) for axes in self._axes])[:-1]
        parts = np.split(points, ends)
        return [part.T if len(part) else np.zeros((1, 0)) for part in parts]

    def _with(self, values: Sequence[FloatArray]) -> TopChain:
        chain = self._chain
        for index, names in enumerate(self._names):
            named = dict(zip(names, map(float, values[index]), strict=True))
            chain = replaced(chain, index, named)
        return chain


def fine_line(domain: Range, degrees: int) -> FloatArray:
    """Return the candidates of one variable."""
    if domain.periodic:
        return np.linspace(
            domain.low,
            domain.high,
            360 // degrees,
            endpoint=False,
        )
    count = max(2, round((domain.high - domain.low) / (SPEED_STEP * degrees)) + 1)
    return np.linspace(domain.low, domain.high, count)


def compared(
    tools: Toolset,
    library: TopLibrary,
    case: Case,
    seed: int,
    index: int,
) -> list[float]:
    """Return predicted cost and executed duration of the search, then of the reference, in s."""
    name = list(tools.domain.chains)[case.chain]
    trial = random_trial(
        tools.domain,
        name,
        library,
        seed=seed,
        index=index,
    )
    refiner = tools.refiner(gated=True)
    chain = refiner.naive(trial.world, case.opened(trial.chain))
    known = Reference(tools, trial, chain)
    best = known.optimized(index) if case.degrees is None else known.brute_force(case.degrees)
    numbers = []
    for found in (refiner.refine(trial.world, chain).best, best):
        objective = expected_time(refiner.failure_cost)
        predicted = predict_chain(
            trial.world,
            found,
            refiner.models,
            tools.robot,
            objective,
        )
        run = run_chain(tools.robot, library, trial.world, found)
        numbers += [predicted.cost, run.duration]
    return numbers


def main(argv: Sequence[str] | None = None) -> int:
    """Print for each case the costs above the reference, as predicted and as executed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)} (default: all)"
    )
    parser.add_argument(
        "--situations",
        type=int,
        default=125,
        metavar="N",
        help="of each case",
    )
    parser.add_argument("--seed", type=int, default=2051)
    options = parser.parse_args(argv)
    tools, library = tools_of(ToolsetSource())
    print("| open | reference | near | predicted above it | executed less it, s (95 %) |")
    print("|---|---|---|---|---|")
    for name in options.cases or CASES:
        case = CASES[name]
        reference = "global optimizer" if case.degrees is None else "brute force"
        numbers = range(options.situations)
        rows = [compared(tools, library, case, options.seed, number) for number in numbers]
        cost, taken, least, least_taken = np.array(rows).T
        above = cost / least - 1.0
        later = taken - least_taken
        low, high = mean_ci95(later)
        print(
            f"| {name} | {reference} "
            f"| {100.0 * (above <= NEAR).mean():.1f} % | {100.0 * above.mean():.3f} % "
            f"| {later.mean():+.4f} ({low:+.4f} to {high:+.4f}) |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
