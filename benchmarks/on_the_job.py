"""Measure what learning on the job gains, starting without models.

    scripts/run python benchmarks/on_the_job.py --chains 100 --seed 2041 --work on_the_job

The chains are those of `evaluate --domain pursuit --seed 2041`. With `--oracle-from`, gains are
compared with the oracle of such an evaluation. Each chain is executed as the nodes would do it with
the current models. Before there are models, and for the baseline, headings are the bearings from
the preceding stations. The learner of the node `learning` runs without ROS, one round at a time.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.actions import DEFAULT_SET
from ator_ros.actions.situation import Situation
from ator_ros.domains.available_models import models_for, with_path_times
from ator_ros.domains.domain import Domain, find_domain
from ator_ros.domains.trials import Trial, random_trial
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import arrive
from ator_ros.evaluation.toolset import Toolset
from ator_ros.execution.chain_executor import ActionRecord, ChainExecutor, Ending
from ator_ros.experience.store import StoreInfo
from ator_ros.experience.table import Episode
from ator_ros.files import read_json
from ator_ros.geometry import FloatArray
from ator_ros.learning.gains import ChainGain
from ator_ros.learning.learner import Learner
from ator_ros.learning.round import Source, learn
from ator_ros.learning.sets import current_set
from ator_ros.performance.accuracy import mean_ci95
from ator_ros.refinement.gate import Gate
from ator_ros.refinement.refiner import Refinement, Refiner

COMPARISON_SHARE = 0.1  # greatest share of chains that run naive, for comparison


class _Round:
    """A round of learning that runs when its result is requested."""

    done = True

    def __init__(self, source: Source) -> None:
        self._source = source

    def result(self) -> dict[str, Any]:
        return learn(self._source, time="2026-01-01T00:00:00Z")

    def kill(self) -> None:
        pass


def episode(record: ActionRecord) -> Episode:
    """Return the episode of an executed action."""
    call = record.chain.calls[record.index]
    start = record.start
    return Episode(
        Situation(call.top.action, start.robot, start.objects, call.goal),
        record.duration,
        record.ending is Ending.SUCCEEDED,
        record.reason,
        record.position_error,
        record.heading_error,
        parts=record.parts,
    )


def refine(
    domain: Domain,
    learner: Learner,
    folder: Path,
    trial: Trial,
) -> Refinement:
    """Refine the chain of a trial with the current models, at first path times."""
    robot = domain.robot(None)
    place = current_set(folder)
    if place is None:
        models = with_path_times({}, domain, robot, DEFAULT_SET)
    else:
        models = models_for(domain, robot, folder=place)
    drawn = random.random() < learner.gains.comparison_share(COMPARISON_SHARE)
    gate = Gate(measured=learner.gains.measured, drawn=drawn)
    refiner = Refiner(
        robot,
        models,
        gate,
        ranges=domain.ranges,
        failure_cost=domain.time_limit,
    )
    return refiner.refine(trial.world, trial.chain, placeholders=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--domain", default="pursuit")
    parser.add_argument("--chains", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2041)
    parser.add_argument(
        "--work", type=Path, required=True, help="a new folder for records and learned sets"
    )
    parser.add_argument(
        "--oracle-from", type=Path, help="folder of an evaluation of the same chains"
    )
    options = parser.parse_args(argv)
    domain = find_domain(options.domain)
    robot = domain.robot(None)
    chain = next(iter(domain.chains))
    library = domain.library(robot)
    folder = options.work
    folder.mkdir(parents=True)
    source = Source(folder, domain, robot, folder / "none")
    begin: Any = lambda: _Round(source)  # noqa: E731
    learner = Learner(
        folder,
        StoreInfo(robot.digest(), domain.name),
        begin,
        start="",
        batch=20,
    )
    best = np.full(options.chains, math.nan)
    if options.oracle_from:
        evaluation = read_json(options.oracle_from / "evaluation.json")
        best[:] = evaluation["runs"]["oracle"]["best"][: options.chains]
    rows = []
    random.seed(options.seed)
    for index in range(options.chains):
        trial = random_trial(
            domain,
            chain,
            library,
            seed=options.seed,
            index=index,
        )
        usual = arrive(Toolset(domain, robot, {}), trial).chain
        execute = partial(
            run_chain,
            robot,
            library,
            trial.world,
            time_limit=domain.time_limit,
        )
        baseline = execute(usual).duration
        found = refine(domain, learner, folder, trial)
        driven = found.chain
        executor = ChainExecutor(library, driven, time_limit=domain.time_limit)
        run = execute(driven, executor=executor)
        for record in executor.records:
            learner.take(DEFAULT_SET, episode(record))
        if run.success and (found.refined or found.comparison):
            excess = run.duration - found.predicted.duration
            learner.take_chain(ChainGain(found.refined, found.saved, excess))
        learner.work(float(index))  # a round may begin,
        learner.work(float(index))  # and end
        rows.append((baseline - run.duration, baseline - best[index], baseline, found.comparison))
        gain = f"{rows[-1][0]:+.2f} s less than the baseline"
        print(f"{index + 1}: {run.duration:.2f} s, {gain}; {found.reason}", flush=True)
    gains: FloatArray = np.array(rows, dtype=float)
    half = len(gains) // 2
    for name, part in (("first", gains[:half]), ("last", gains[half:])):
        low, high = mean_ci95(part[:, 0])
        gained, possible, usual_time, share = part.mean(axis=0)
        print(
            f"the {name} {len(part)}: {gained:.2f} s ({low:.2f} to {high:.2f}) less than "
            f"{usual_time:.2f} s, {100.0 * gained / possible:.0f} % of the oracle's "
            f"{possible:.2f} s; {share:.0%} to compare"
        )
    print(f"measured gain per refined chain: {learner.gains.measured}")
    learner.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
