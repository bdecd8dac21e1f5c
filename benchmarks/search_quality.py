"""How near the search comes to the best there is, and what a better search is worth once it is executed.

In each situation a chain is searched as `refine` does, and for a reference. With up to three free variables
that is every combination of a fine grid: 1 degree of each heading (2 where three are open) and 0.05 m/s (0.1)
of each speed. With more it is a long run of a global optimiser. The best chains of both are executed. An
interrupted run goes on where it was:
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
from typing import Any, NamedTuple

import numpy as np
from references import Reference
from resumed import OtherResultsError, resumed

from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import Toolset
from ator_ros.evaluation.statistics import mean_interval
from ator_ros.evaluation.toolset import ToolsetSource, tools_of
from ator_ros.evaluation.trials import open_places, open_speeds, random_trial
from ator_ros.files import portable_command, write_text
from ator_ros.formats import Format
from ator_ros.refinement.chain_prediction import predict_chain
from ator_ros.refinement.objective import expected_time
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary

FORMAT = Format("ator_ros search quality", 2, "quality of the search")
NEAR = 0.005
"""Share by which a search may be above the reference."""


class Case(NamedTuple):
    """What is open in the chain of a domain with this number; degrees between fine candidates, if any."""

    chain: int
    opened: Callable[[TopChain], TopChain]
    degrees: int | None


def _as_planned(chain: TopChain) -> TopChain:
    return chain


def _first_speed_open(chain: TopChain) -> TopChain:
    first, *others = chain.calls
    return TopChain((dataclasses.replace(first, open=first.open | {"speed"}), *others))


CASES = {
    "heading": Case(0, _as_planned, 1),
    "heading and speed": Case(0, open_speeds, 1),
    "two headings": Case(-1, _as_planned, 1),
    "two headings and a speed": Case(-1, _first_speed_open, 2),
    "two headings and speeds": Case(-1, open_speeds, None),
    "place, headings and speeds": Case(-1, open_places, None),
}


def evaluated(tools: Toolset, library: TopLibrary, name: str, seed: int, index: int) -> dict[str, Any]:
    """Search one chain both ways, and execute what is found."""
    case = CASES[name]
    chain_name = list(tools.domain.chains)[case.chain]
    trial = random_trial(tools.domain, chain_name, library, seed=seed, index=index)
    refiner = tools.refiner(gated=True)
    chain = refiner.naive(trial.world, case.opened(trial.chain))
    known = Reference(tools, trial, chain)
    best = known.optimised(index) if case.degrees is None else known.brute_force(case.degrees)
    record: dict[str, Any] = {"case": name, "index": index}
    for which, found in (("search", refiner.refine(trial.world, chain).best), ("reference", best)):
        objective = expected_time(refiner.failure_cost)
        predicted = predict_chain(trial.world, found, refiner.models, tools.robot, objective)
        run = run_chain(tools.robot, library, trial.world, found)
        record[which] = {
            "cost": round(predicted.cost, 4),
            "duration": round(run.duration, 3),
            **({} if run.success else {"failed": run.reason}),
        }
    return record


def summary(case: str, records: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return how near the predicted costs are, and by how much the executed durations differ."""
    own = [record for record in records if record["case"] == case]
    cost, least = (np.array([each[which]["cost"] for each in own]) for which in ("search", "reference"))
    taken, least_taken = (
        np.array([each[which]["duration"] for each in own]) for which in ("search", "reference")
    )
    above = cost / least - 1.0
    low, high = mean_interval(taken - least_taken)
    return {
        "open": case,
        "reference": "global optimiser" if CASES[case].degrees is None else "brute force",
        "situations": len(own),
        "near_percent": round(100.0 * float((above <= NEAR).mean()), 1),
        "above_percent_mean": round(100.0 * float(above.mean()), 3),
        "above_percent_p99": round(100.0 * float(np.quantile(above, 0.99)), 2),
        "executed_less_reference_s": round(float((taken - least_taken).mean()), 4),
        "executed_less_reference_s_ci95": [round(low, 4), round(high, 4)],
        "predicted_s": [round(float(each.mean()), 3) for each in (cost, least)],
        "executed_s": [round(float(each.mean()), 3) for each in (taken, least_taken)],
        "failures": [sum("failed" in each[which] for each in own) for which in ("search", "reference")],
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
