"""Execute the same chains over ROS and in the tools; report how durations and predictions differ."""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator
from typing import Any

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.toolset import tools_of
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.files import write_text
from ator_ros.schema import unstructured
from ator_ros.tools.command_line import source_of
from ator_ros.tools.processes import all_nodes, node_setting
from ator_ros.tools.work.comparison import FORMAT, Compared, comparison

_FRAME = "odom"


def run(options: argparse.Namespace, domain: Domain, command: str) -> int:
    """Do what the command line asks for; return the exit code."""
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        print(f"compare: {error}: source your ROS 2 workspace, or use make run EXE=compare", file=sys.stderr)
        return 1
    runs: list[Compared] = []
    for number, one in enumerate(_runs(options, domain), start=1):
        print(
            f"{number} of {options.situations}: over ROS {one.ros:.2f} s, "
            f"in the tools {one.tools:.2f} s, predicted {one.predicted:.2f} s"
        )
        runs.append(one)
    result = comparison(
        runs,
        command=command,
        seed=options.seed,
        real_time_factor=options.real_time_factor,
        chains=options.chains,
        policies=options.policies,
    )
    write_text(options.out, FORMAT.text(unstructured(result)))
    print(f"means differ by {result.difference_percent:.2f} %; wrote {options.out}")
    errors = result.prediction
    if errors is not None and errors.mean_error_s is not None and errors.mean_error_ci95 is not None:
        low, high = errors.mean_error_ci95
        mean = errors.mean_error_s
        print(f"predicted minus actual over ROS: {mean:+.3f} s in the mean (95 %: {low:+.3f} to {high:+.3f})")
    return 0 if result.met else 1


def _runs(options: argparse.Namespace, domain: Domain) -> Iterator[Compared]:
    """Start the nodes and execute the situations one by one."""
    from ator_ros.tools.work.demo_client import DemoClient

    source = source_of(options)
    tools, library = tools_of(source)
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
    from ator_ros.nodes.messages import chain_of

    client.place(trial.world)
    run = client.execute(chain_of(trial.chain, action_set=action_set, frame=_FRAME), refine=False)
    return (float(run.total[1]) if run.success else 0.0), float(run.total[0])
