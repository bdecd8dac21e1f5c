"""Measure the gain of refining a chain again while it is executed.

The ball rolls at the start.

scripts/run python benchmarks/along.py --situations 200

`test/refined_along.py` executes the chain as the executor node does, without ROS.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ator_ros.domains.trials import random_trial
from ator_ros.evaluation.chain_run import ChainRun, run_chain
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.experience.parallel import progress, run_tasks, workers
from ator_ros.performance.accuracy import mean_ci95

TEST = Path(__file__).parents[1] / "test"


def both(index: int, *, seed: int) -> tuple[ChainRun, ChainRun]:
    """Execute a chain that is refined once, and one that is refined again along the way.

    `index` is the number of the situation.
    """
    if str(TEST) not in sys.path:  # in each worker process
        sys.path.append(str(TEST))
    from refined_along import refining_along

    tools, library = tools_of(ToolsetSource())
    trial = random_trial(
        tools.domain,
        "rolling",
        library,
        seed=seed,
        index=index,
    )
    chain, refined_along = refining_along(tools, library, trial)
    executor: Any = refined_along  # has the methods of a ChainExecutor that run_chain calls
    execute = partial(
        run_chain,
        tools.robot,
        library,
        trial.world,
        time_limit=tools.domain.time_limit,
    )
    return execute(chain), execute(chain, executor=executor)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(prog="along", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--situations", type=int, default=200, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--seed", type=int, default=2063, help="default: %(default)s")
    options = parser.parse_args(argv)
    tasks = range(options.situations)
    with workers(-1):
        found = run_tasks(partial(both, seed=options.seed), tasks)
        runs = list(progress(found, done=0, total=len(tasks), unit="situation"))
    durations = [(once.duration, along.duration) for once, along in runs]
    once, along = np.array(durations).T
    failed = [sum(not run.success for run in column) for column in zip(*runs, strict=True)]
    low, high = mean_ci95(once - along)
    print(f"refined once: {once.mean():.2f} s, {failed[0]} failed")
    print(f"along the way: {along.mean():.2f} s, {failed[1]} failed")
    print(f"gained along the way: {(once - along).mean():.2f} s ({low:.2f} to {high:.2f})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
