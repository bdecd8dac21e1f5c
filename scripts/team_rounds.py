"""What dividing a round by predicted times gains over dividing it by distance.

Eight stations are divided among robots, whose chains are then executed one by one in the
simulator. A round lasts until the last robot is done. Results are appended to a file, and the same
command resumes:

scripts/run python scripts/team_rounds.py tour --robots 2 --rounds 100 --out tour_2.jsonl
"""

from __future__ import annotations

import json
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ator_ros.actions.goal_variables import ORDER
from ator_ros.domains.trials import random_trial
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.orders import along_routes, straight
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.geometry import FloatArray
from ator_ros.performance.accuracy import mean_ci95
from ator_ros.refinement.step_durations import DurationTable
from ator_ros.team.division import Steps, divide
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ordering import ordering_of
from ator_ros.world.state import World

STATIONS = 8
POLICIES = ("straight", "routes", "predicted")


def round_of(
    tools: Toolset, library: TopLibrary, robots: int, seed: int, number: int
) -> tuple[list[World], TopChain]:
    """Draw where the robots start, and the stations, from several random rounds of one robot."""
    drawn = [
        random_trial(tools.domain, "round", library, seed=seed, index=number * robots + robot)
        for robot in range(robots)
    ]
    calls = [call for trial in drawn for call in trial.chain.calls[:-1]][:STATIONS]
    opened = [replace(call, open=frozenset({"yaw", ORDER})) for call in calls]
    return [trial.world for trial in drawn], TopChain(tuple(opened))


def table_of(policy: str, tools: Toolset, start: World, chain: TopChain) -> FloatArray:
    """Return the times or lengths from step to step, as `divide` needs them."""
    if policy == "predicted":
        table = DurationTable.of_pairs(
            [start], chain.calls, tools.models, robot=tools.robot, ranges=tools.domain.ranges
        )
        return table.whole().durations
    lengths = straight if policy == "straight" else along_routes
    ends = np.array([call.goal.pose[:2] for call in chain.calls])
    origins = np.vstack((start.robot.pose[:2], ends))
    pairs = np.repeat(origins, len(ends), axis=0), np.tile(ends, (len(origins), 1))
    found = lengths(tools.robot, pairs[0].T, pairs[1].T)
    return found.reshape(len(origins), len(ends))


def executed(
    policy: str, tools: Toolset, library: TopLibrary, starts: Sequence[World], chain: TopChain
) -> tuple[float, float]:
    """Return the time in s until the last robot is done, and the sum; NaN if a chain failed."""
    tables = [table_of(policy, tools, start, chain) for start in starts]
    division = divide(tables, Steps.of(ordering_of(chain)))
    refiner = tools.refiner()
    times = []
    for start, order in zip(starts, division.orders, strict=True):
        if not order:
            continue
        own = TopChain(tuple(chain.calls[step] for step in order))
        refined = refiner.refine(start, own, placeholders=True).chain
        limit = tools.domain.time_limit * len(order)
        run = run_chain(tools.robot, library, start, refined, time_limit=limit)
        times.append(run.duration if run.success else np.nan)
    return float(np.max(times)), float(np.sum(times))


def main() -> None:
    """Execute the rounds that are missing, and print the table."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("domain")
    parser.add_argument("--robots", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--seed", type=int, default=3000)
    parser.add_argument("--models", default="")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    tools, library = tools_of(ToolsetSource(domain=options.domain, models=options.models))
    lines = options.out.read_text(encoding="utf-8").splitlines() if options.out.exists() else []
    results = [json.loads(line) for line in lines]
    for number in range(len(results), options.rounds):
        starts, chain = round_of(tools, library, options.robots, options.seed, number)
        results.append(
            {policy: executed(policy, tools, library, starts, chain) for policy in POLICIES}
        )
        with options.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(results[-1]) + "\n")
    last = {policy: np.array([each[policy][0] for each in results]) for policy in POLICIES}
    known = np.isfinite(list(last.values())).all(axis=0)
    reference = last["straight"][known]
    print(f"{known.sum()} rounds, {(~known).sum()} with a failed chain")
    print("| divided by | last robot done | gain (95 %) |\n| --- | --- | --- |")
    for policy, times in last.items():
        gain = 100.0 * (reference - times[known]) / reference.mean()
        low, high = mean_ci95(gain)
        mean = times[known].mean()
        print(f"| {policy} | {mean:.2f} s | {gain.mean():.1f} % ({low:.1f} to {high:.1f}) |")


if __name__ == "__main__":
    main()
