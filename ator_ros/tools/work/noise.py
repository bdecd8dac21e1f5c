"""Measure how often chains succeed with the sensors of a real robot, or late states, against the truth."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence

from tqdm import tqdm

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.noise import POINTS, TRUTH, NoiseTask, execute, summarise
from ator_ros.evaluation.noise_result import FORMAT, ConditionResult, NoiseResult
from ator_ros.experience.parallel import run_tasks
from ator_ros.files import write_text
from ator_ros.schema import unstructured
from ator_ros.simulation.sensors import REALISTIC, REALISTIC_SIGHT
from ator_ros.tools.command_line import source_of


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    seen = dict.fromkeys(domain.objects, REALISTIC_SIGHT)
    result = NoiseResult(
        command=command,
        seed=options.seed,
        situations=options.situations,
        policy=options.policy,
        action_set=options.action_set,
        robot_digest=source_of(options).described().digest(),
        sensors=dataclasses.replace(REALISTIC, objects=seen),
        limit_points=POINTS,
        chains={chain: _measure(chain, options) for chain in options.chains},
    )
    write_text(options.out, FORMAT.text(unstructured(result)))
    print(_table(result.chains))
    print(f"written to {options.out}")
    return 0


def _measure(chain: str, options: argparse.Namespace) -> tuple[ConditionResult, ...]:
    source = source_of(options)
    conditions = (TRUTH, *(name for name in options.conditions if name != TRUTH))
    work = [
        NoiseTask(options.seed, index, chain, options.policy, conditions, source)
        for index in range(options.situations)
    ]
    runs = run_tasks(execute, work, jobs=options.jobs)
    return summarise(list(tqdm(runs, total=len(work), desc=chain, disable=None)))


def _table(chains: Mapping[str, Sequence[ConditionResult]]) -> str:
    lines = [f"{'chain':10}{'condition':36}{'success %':>10}{'below truth':>13}{'95 %':>18}{'mean s':>9}"]
    for chain, rows in chains.items():
        for row in rows:
            low, high = row.points_below_truth_ci95
            mean = "-" if row.mean_duration_s is None else f"{row.mean_duration_s:.2f}"
            lines.append(
                f"{chain:10}{row.condition:36}{row.success_percent:10.1f}"
                f"{row.points_below_truth:13.1f}{f'{low:.1f} to {high:.1f}':>18}"
                f"{mean:>9}"
            )
            lines += [f"{'':14}{count} x {reason}" for reason, count in row.failures.items()]
    return "\n".join(lines)
