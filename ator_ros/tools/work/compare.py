"""Execute the same chains over ROS and in the tools; report how durations and predictions differ."""

from __future__ import annotations

import argparse
import itertools
import math
import platform
import statistics
import sys
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.statistics import prediction_errors
from ator_ros.evaluation.toolset import make_library, make_toolset
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.experience.table import library_versions
from ator_ros.files import write_text
from ator_ros.formats import Format
from ator_ros.nodes.machine import MachineError
from ator_ros.tools.command_line import source_of
from ator_ros.tools.processes import NodeEndedError, all_nodes, node_setting

FORMAT = Format("ator_ros comparison", 1, "comparison of nodes and tools")

LIMIT_PERCENT = 2.0
"""Greatest allowed difference of the mean durations."""
_FRAME = "odom"


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    try:
        from ator_ros.tools.work.demo_client import DemoError
    except ImportError as error:
        print(f"compare: {error}: source your ROS 2 workspace, or use make run EXE=compare", file=sys.stderr)
        return 1
    runs: list[Compared] = []
    try:
        for number, one in enumerate(_runs(options, domain), start=1):
            print(
                f"{number} of {options.situations}: over ROS {one.ros:.2f} s, "
                f"in the tools {one.tools:.2f} s, predicted {one.predicted:.2f} s"
            )
            runs.append(one)
    except (DemoError, MachineError, NodeEndedError) as error:
        print(f"compare: {error}", file=sys.stderr)
        return 1
    result = {
        "command": command,
        "seed": options.seed,
        "real_time_factor": options.real_time_factor,
        "chains": options.chains,
        "policies": options.policies,
        **summary(runs),
        "prediction": prediction_summary(runs),
        "versions": library_versions(),
        "machine": platform.platform(),
    }
    write_text(options.out, FORMAT.text(result))
    print(f"means differ by {result['difference_percent']:.2f} %; wrote {options.out}")
    if "mean_error_s" in result["prediction"]:
        low, high = result["prediction"]["mean_error_ci95"]
        mean = result["prediction"]["mean_error_s"]
        print(f"predicted minus actual over ROS: {mean:+.3f} s in the mean (95 %: {low:+.3f} to {high:+.3f})")
    return 0 if result["met"] else 1


class Compared(NamedTuple):
    """Durations in s of one chain over ROS and in the tools, failed at the time limit, and as predicted."""

    ros: float
    tools: float
    predicted: float = math.nan


def summary(runs: Sequence[Compared]) -> dict[str, Any]:
    """Compare durations over ROS and in the tools."""
    ros, tools = statistics.fmean(run.ros for run in runs), statistics.fmean(run.tools for run in runs)
    apart = [run.ros - run.tools for run in runs]
    percent = 100.0 * (ros / tools - 1.0)
    return {
        "situations": len(runs),
        "mean_ros_s": round(ros, 3),
        "mean_tools_s": round(tools, 3),
        "difference_percent": round(percent, 3),
        "limit_percent": LIMIT_PERCENT,
        "met": abs(percent) <= LIMIT_PERCENT,
        "same_to_the_tick": sum(abs(difference) < 1e-6 for difference in apart),
        "differences_s": [round(difference, 3) for difference in apart],
    }


def prediction_summary(runs: Sequence[Compared]) -> dict[str, Any]:
    """Compare the executor's predictions for the chains that succeeded with their durations over ROS."""
    known = [run for run in runs if math.isfinite(run.predicted)]
    rows = [
        {"policies": {"ros": {"duration": run.ros, "predicted": run.predicted, "success": True}}}
        for run in known
    ]
    errors = [round(run.predicted - run.ros, 3) for run in known]
    return {**prediction_errors(rows, "ros"), "errors_s": errors}


def _runs(options: argparse.Namespace, domain: Domain) -> Iterator[Compared]:
    """Start the nodes and execute the situations one by one."""
    from ator_ros.tools.work.demo_client import DemoClient

    source = source_of(options)
    tools, library = make_toolset(source), make_library(source.described(), source)
    kinds = itertools.cycle(itertools.product(options.chains, options.policies))
    with (
        all_nodes(options.real_time_factor, **node_setting(options)) as nodes,
        DemoClient(nodes.domain, nodes.check, tools.domain.objects) as client,
    ):
        client.ready(domain.remote_servers(options.action_set), len(domain.programs))
        for index, (name, policy) in zip(range(options.situations), kinds, strict=False):
            trial = random_trial(domain, name, library, seed=options.seed, index=index)
            chain = POLICIES[policy](tools, trial).chain
            limit = domain.time_limit
            run = run_chain(tools.robot, library, trial.world, chain, time_limit=limit)
            ros, predicted = _over_ros(client, Trial(index, trial.world, chain), options.action_set)
            # A chain that failed counts its limit, as in the tools, and has no prediction to be compared.
            yield Compared(ros, run.duration, predicted) if ros else Compared(limit, run.duration, math.nan)


def _over_ros(client: Any, trial: Trial, action_set: str) -> tuple[float, float]:
    """Return how long a chain took over ROS, 0 if it failed, and what the executor predicted, both in s."""
    from ator_ros.nodes.conversions import chain_of

    client.place(trial.world)
    run = client.execute(chain_of(trial.chain, action_set=action_set, frame=_FRAME), refine=False)
    return (float(run.total[1]) if run.success else 0.0), float(run.total[0])
