"""How near the search comes to brute force, and what a finer search is worth once it is executed.

In each situation a chain is searched as `refine` does, and with every combination of a fine grid: 1 degree
of each heading (2 where three variables are open) and 0.05 m/s (0.1) of each speed. The best chains of both
are executed. An interrupted run goes on where it was:
    scripts/run python benchmarks/search_quality.py --seed 2051 --out docs/search_quality.json
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from resumed import OtherResultsError, resumed

from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import Toolset
from ator_ros.evaluation.statistics import mean_interval
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.evaluation.trials import Trial, open_speeds, random_trial
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.geometry import FloatArray
from ator_ros.refinement.bounds import names_of
from ator_ros.refinement.chain_model import ChainModel, predict_chain
from ator_ros.refinement.naive import replaced
from ator_ros.refinement.objective import expected_time
from ator_ros.refinement.paths import least_path
from ator_ros.refinement.slices import completed
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ranges import Range

FORMAT = Format("ator_ros search quality", 1, "quality of the search")
NEAR = 0.005
"""Share by which a search may be above brute force."""
SPEED_STEP = 0.05


def _first_speed_open(chain: TopChain) -> TopChain:
    first, *others = chain.calls
    return TopChain((dataclasses.replace(first, open=first.open | {"speed"}), *others))


CASES: dict[str, tuple[int, int, Callable[[TopChain], TopChain]]] = {
    "heading": (0, 1, lambda chain: chain),
    "heading and speed": (0, 1, open_speeds),
    "two headings": (-1, 1, lambda chain: chain),
    "two headings and a speed": (-1, 2, _first_speed_open),
}
"""By what is open: number of the domain's chain, degrees between fine candidates, and how it is opened."""


def fine_line(domain: Range, degrees: int) -> FloatArray:
    """Return the fine candidates of one variable; speeds are as much coarser as angles are."""
    if domain.periodic:
        return np.linspace(domain.low, domain.high, 360 // degrees, endpoint=False)
    count = max(2, round((domain.high - domain.low) / (SPEED_STEP * degrees)) + 1)
    return np.linspace(domain.low, domain.high, count)


def brute_force(tools: Toolset, trial: Trial, chain: TopChain, degrees: int) -> TopChain:
    """Return the best of all chains on the fine grid, or `chain` where none is better."""
    refiner = tools.refiner(gated=True)
    analysis, _ = refiner.bounded(trial.world, chain)
    model = ChainModel(
        trial.world, chain, tools.robot, models=refiner.models, free=analysis.free,
        objective=expected_time(refiner.failure_cost),
    )  # fmt: skip
    grids = []
    for index, given in enumerate(model.given):
        lines = [fine_line(each.domain, degrees) for each in analysis.free if each.subgoal == index]
        grid = np.array(list(itertools.product(*lines)), dtype=float)
        grids.append(np.vstack([given, grid]) if lines else grid)
    path = completed(least_path(model.step_cost, grids, model.given))
    for index, names in enumerate(names_of(chain, analysis.free)):
        chain = replaced(chain, index, dict(zip(names, path.values[index], strict=True)))
    return chain


def evaluated(tools: Toolset, library: TopLibrary, case: str, seed: int, index: int) -> dict[str, Any]:
    """Search one chain both ways, and execute what is found."""
    number, degrees, opened = CASES[case]
    name = list(tools.domain.chains)[number]
    trial = random_trial(tools.domain, name, library, seed=seed, index=index)
    refiner = tools.refiner(gated=True)
    chain = refiner.naive(trial.world, opened(trial.chain))
    found = refiner.refine(trial.world, chain).best
    record: dict[str, Any] = {"case": case, "index": index}
    for which, best in (("search", found), ("brute_force", brute_force(tools, trial, chain, degrees))):
        objective = expected_time(refiner.failure_cost)
        predicted = predict_chain(trial.world, best, refiner.models, tools.robot, objective)
        run = run_chain(tools.robot, library, trial.world, best)
        record[which] = {
            "cost": round(predicted.cost, 4),
            "duration": round(run.duration, 3),
            **({} if run.success else {"failed": run.reason}),
        }
    return record


def summary(case: str, records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return how near the predicted costs are, and by how much the executed durations differ."""
    own = [record for record in records if record["case"] == case]
    cost, fine = (np.array([each[which]["cost"] for each in own]) for which in ("search", "brute_force"))
    taken, fine_taken = (
        np.array([each[which]["duration"] for each in own]) for which in ("search", "brute_force")
    )
    above = cost / fine - 1.0
    low, high = mean_interval(taken - fine_taken)
    return {
        "open": case,
        "situations": len(own),
        "near_percent": round(100.0 * float((above <= NEAR).mean()), 1),
        "above_percent_mean": round(100.0 * float(above.mean()), 3),
        "above_percent_p99": round(100.0 * float(np.quantile(above, 0.99)), 2),
        "executed_less_brute_force_s": round(float((taken - fine_taken).mean()), 4),
        "executed_less_brute_force_s_ci95": [round(low, 4), round(high, 4)],
        "mean_s": round(float(taken.mean()), 3),
        "failures": [sum("failed" in each[which] for each in own) for which in ("search", "brute_force")],
    }


def main(words: list[str]) -> int:
    """Evaluate what is not in the partial results yet, and write the summary; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--situations", type=int, default=125, metavar="N", help="of each case")
    parser.add_argument("--seed", type=int, default=2051)
    parser.add_argument("--out", type=Path, default=Path("search_quality.json"))
    options = parser.parse_args(words)
    source = ToolsetSource()
    tools, library = tools_of(source)
    partial = options.out.with_suffix(".jsonl")
    identity = {"seed": options.seed, "digest": source.digest(("gated",), "shoot")}
    todo = list(itertools.product(range(options.situations), CASES))
    try:
        records = resumed(
            partial, identity, todo, lambda item: evaluated(tools, library, item[1], options.seed, item[0])
        )
    except OtherResultsError as error:
        print(error, file=sys.stderr)
        return 2
    result = {
        "command": portable_command("search_quality", words),
        "cases": [summary(case, records) for case in CASES],
    }
    write_text(options.out, FORMAT.text({**result, "records": records}))
    print(json.dumps(result, indent=1))
    partial.unlink()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
