"""What refined places, headings and speeds reach of a dense executed oracle over all of them, with a shot.

Of points spread evenly over what is open, the oracle executes those that are predicted best, far enough
apart, and then points around the best executed ones. The policies' own chains count as well.
    scripts/run python benchmarks/dense_oracle.py --situations 60 --seed 2033 --out docs/dense_oracle.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ator_ros.evaluation.chain_run import ChainRun
from ator_ros.evaluation.policies import POLICIES, Toolset
from ator_ros.evaluation.situation import Executions, Record, Settings
from ator_ros.evaluation.statistics import outcomes, summarise
from ator_ros.evaluation.storage import PartialResults
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.evaluation.trials import Trial, open_places, random_trial
from ator_ros.experience.parallel import run_tasks
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_prediction import ChainModel
from ator_ros.refinement.free_variables import names_of
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import replaced
from ator_ros.refinement.search import into_domains, spread_points
from ator_ros.tops.chain import TopChain

FORMAT = Format("ator_ros dense oracle", 1, "dense oracle")
SPREAD = 8192
"""Points that are predicted, before the bounds of the regions."""
APART = 0.08
"""Least distance between executed points of the first half, in shares of the variables' ranges."""
AROUND = 6
"""Best executed points that the second half lies around."""
NEAR = 0.06
"""Standard deviation of the second half, in shares of the variables' ranges."""


class Space:
    """The free variables of one chain as one box: points (n, k) of all subgoals' variables in a row."""

    def __init__(self, tools: Toolset, trial: Trial, chain: TopChain) -> None:
        self._robot, self._world, self._chain = tools.robot, trial.world, chain
        refiner = tools.refiner()
        analysis, regions = refiner.bounded(trial.world, chain)
        self._free, self._allowed = analysis.free, regions.allowing()
        self._model = ChainModel(
            trial.world,
            chain,
            tools.robot,
            models=refiner.models,
            names=names_of(chain, self._free),
            objective=Objective(),
        )
        self._domains = [variable.domain for variable in self._free]
        self._low = np.array([domain.low for domain in self._domains])
        self.span = np.array([domain.high for domain in self._domains]) - self._low

    def spread(self, count: int) -> FloatArray:
        """Return the points that are allowed among `count` evenly spread ones."""
        return self.allowed(self._low + self.span * spread_points(len(self._free), 0, count))

    def near(self, centre: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
        """Return allowed points around `centre`, up to `count`."""
        points = centre + NEAR * self.span * rng.normal(size=(4 * count, len(centre)))
        into_domains(points, self._domains)
        return self.allowed(points)[:count]

    def allowed(self, points: FloatArray) -> FloatArray:
        """Return the points that the regions of the conditions allow."""
        for index in range(len(self._chain.calls)):
            values = self._parts(points)[index]
            if self._allowed is not None and values.shape[1]:
                points = points[self._allowed(index, values)]
        return points

    def _parts(self, points: FloatArray) -> list[FloatArray]:
        """Return the values of each subgoal's variables, shapes (n, k)."""
        subgoals = np.array([variable.subgoal for variable in self._free])
        return [points[:, subgoals == index] for index in range(len(self._chain.calls))]

    def costs(self, points: FloatArray) -> FloatArray:
        """Return the predicted duration in s at each point, shape (n,)."""
        parts, total = self._parts(points), np.zeros(len(points))
        before = np.zeros((len(points), 0))
        for index, after in enumerate(parts):
            total = total + self._model.step_cost(index, before, after)
            before = after
        return total

    def chain(self, point: FloatArray) -> TopChain | None:
        """Return the chain of a point; None where it is no valid plan."""
        chain = self._chain
        for variable, value in zip(self._free, point, strict=True):
            chain = replaced(chain, variable.subgoal, {variable.name: float(value)})
        return None if chain.violations(self._world, self._robot) else chain


def best_apart(points: FloatArray, costs: FloatArray, span: FloatArray, count: int) -> Iterator[FloatArray]:
    """Yield up to `count` points in the order of their costs, each away from all before."""
    taken = np.zeros((0, points.shape[1]))
    for row in np.argsort(costs, kind="stable"):
        if len(taken) == count:
            return
        if not np.any(np.linalg.norm((taken - points[row]) / span, axis=1) < APART):
            taken = np.vstack([taken, points[row]])
            yield points[row]


def searched(space: Space, execute: Executions, count: int, seed: Sequence[int]) -> list[ChainRun]:
    """Execute `count` chains of a space."""
    points = space.spread(SPREAD)
    found: list[tuple[ChainRun, FloatArray]] = []

    def try_(point: FloatArray) -> None:
        chain = space.chain(point)
        if chain is not None:
            found.append((execute(chain), point))

    for point in best_apart(points, space.costs(points), space.span, count // 2):
        try_(point)
    rng, rest = np.random.default_rng(seed), count - len(found)
    best = sorted(found, key=lambda one: one[0].duration)[:AROUND]
    for _, centre in best:
        for point in space.near(centre, -(-rest // len(best)), rng):
            try_(point)
    return [run for run, _ in found]


def situation(task: tuple[Settings, int]) -> Record:
    """Return the record of one situation; see `ator_ros.evaluation.situation.evaluate_trial`."""
    settings, index = task
    tools, library = tools_of(settings.source)
    trial = random_trial(tools.domain, settings.chain, library, seed=settings.seed, index=index)
    execute = Executions(tools, library, trial)
    chosen = {name: execute(POLICIES[name](tools, trial).chain) for name in settings.policies}
    plan = open_places(POLICIES["refined_free"](tools, trial).chain)
    tried = searched(Space(tools, trial, plan), execute, settings.oracle, (settings.seed, index))
    best = min((*tried, *chosen.values()), key=lambda run: run.duration)
    return {
        "index": index,
        "policies": {
            name: {"duration": round(run.duration, 3), "success": run.success} for name, run in chosen.items()
        },
        "oracle": {"best": round(best.duration, 3), "success": best.success, "tried": len(tried)},
        "executed": execute.count,
    }


def main() -> None:
    """Evaluate, print the summary, and write it with the records."""
    parser = argparse.ArgumentParser(prog="dense_oracle", description=__doc__)
    parser.add_argument("--situations", type=int, default=60)
    parser.add_argument("--seed", type=int, default=2033)
    parser.add_argument("--count", type=int, default=200, help="chains that the oracle executes each time")
    parser.add_argument("--models", default="", help="folder of the models; by default those that ship")
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument("--work", type=Path, default=Path("dense_oracle"), help="folder of partial results")
    parser.add_argument("--out", type=Path, required=True, help="file of the results")
    options = parser.parse_args()
    policies, source = ("naive", "refined_speed", "refined_free"), ToolsetSource(models=options.models)
    settings = Settings(options.seed, "shoot", policies, options.count, source=source)
    digest = settings.source.digest(settings.policies, settings.chain)
    results = PartialResults(options.work, settings, digest)
    tasks = [(settings, index) for index in range(options.situations) if index not in results.records]
    for record in run_tasks(situation, tasks, jobs=options.jobs):
        results.append(record)
        print(f"{len(results.records)} of {options.situations}", file=sys.stderr)
    records = [results.records[index] for index in range(options.situations)]
    summary = {"situations": len(records), **summarise(outcomes(records))}
    print(json.dumps(summary, indent=1))
    content = {"command": portable_command("dense_oracle", sys.argv[1:]), "summary": summary, "runs": records}
    write_text(options.out, FORMAT.text(content))


if __name__ == "__main__":
    main()
