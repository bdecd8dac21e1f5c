"""Execute the same chains over ROS and in the tools; report how durations and predictions differ."""

from __future__ import annotations

import argparse
import itertools
import json
import math
import platform
import statistics
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.evaluation.policies import POLICIES
from ator_ros.evaluation.statistics import OURS, prediction_errors
from ator_ros.evaluation.toolset import ToolsetSource, make_toolset
from ator_ros.evaluation.trials import Trial, random_trial
from ator_ros.experience.table import library_versions
from ator_ros.files import portable_command, write_text
from ator_ros.nodes.machine import MachineError
from ator_ros.robot.description import load_robot
from ator_ros.simulation.run import TIME_LIMIT
from ator_ros.tools.command_line import INTERRUPTED, destination, whole
from ator_ros.tools.processes import NodeEndedError, all_nodes

LIMIT_PERCENT = 2.0
"""How far the mean durations may be apart."""
_FRAME = "odom"


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `compare`."""
    parser = argparse.ArgumentParser(prog="compare", description=__doc__)
    parser.add_argument("--situations", type=whole(1), default=50, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=941, help="of the situations (default: %(default)s)")
    parser.add_argument(
        "--chains", nargs="+", choices=list(SOCCER.chains), default=["dribble"], help="taken in turn"
    )
    parser.add_argument(
        "--policies", nargs="+", choices=("naive", *OURS), default=["gated"], help="taken in turn"
    )
    parser.add_argument(
        "--real-time-factor",
        type=float,
        default=1.0,
        metavar="F",
        help="simulated per real seconds (default: %(default)s); 0: as fast as the robot is steered",
    )
    parser.add_argument("--out", type=destination, default=Path("build/compare.json"), metavar="FILE.json")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is 1 where the nodes fail or the means are too far apart."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = arguments().parse_args(words)
    try:
        from ator_ros.tools.demo_client import DemoError
    except ImportError as error:
        print(f"compare: {error}: source your ROS 2 workspace, or use make run EXE=compare", file=sys.stderr)
        return 1
    runs: list[Compared] = []
    try:
        for number, run in enumerate(_runs(options), start=1):
            print(
                f"{number} of {options.situations}: over ROS {run.ros:.2f} s, "
                f"in the tools {run.tools:.2f} s, predicted {run.predicted:.2f} s"
            )
            runs.append(run)
    except KeyboardInterrupt:
        print("compare: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    except (DemoError, MachineError, NodeEndedError) as error:
        print(f"compare: {error}", file=sys.stderr)
        return 1
    result = {
        "command": portable_command("compare", words),
        "seed": options.seed,
        "real_time_factor": options.real_time_factor,
        "chains": options.chains,
        "policies": options.policies,
        **summary(runs),
        "prediction": prediction_summary(runs),
        "versions": library_versions(),
        "machine": platform.platform(),
    }
    write_text(options.out, json.dumps(result, indent=1) + "\n")
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
    """Compare what the executor predicted of the chains that succeeded with how long they took over ROS."""
    known = [run for run in runs if run.ros < TIME_LIMIT and math.isfinite(run.predicted)]
    rows = [
        {"policies": {"ros": {"duration": run.ros, "predicted": run.predicted, "success": True}}}
        for run in known
    ]
    errors = [round(run.predicted - run.ros, 3) for run in known]
    return {**prediction_errors(rows, "ros"), "errors_s": errors}


def _runs(options: argparse.Namespace) -> Iterator[Compared]:
    """Start the nodes and execute the situations one by one."""
    from ator_ros.tools.demo_client import DemoClient

    robot = load_robot()
    library, tools = SOCCER.library(robot), make_toolset(ToolsetSource())
    kinds = itertools.cycle(itertools.product(options.chains, options.policies))
    with all_nodes(options.real_time_factor) as nodes, DemoClient(nodes.domain, nodes.check) as client:
        client.ready()
        for index, (name, policy) in zip(range(options.situations), kinds, strict=False):
            trial = random_trial(SOCCER, name, library, seed=options.seed, index=index)
            chain = POLICIES[policy](tools, trial).chain
            run = run_chain(robot, library, trial.world, chain)
            ros, predicted = _over_ros(client, Trial(index, trial.world, chain))
            yield Compared(ros, run.duration, predicted)


def _over_ros(client: Any, trial: Trial) -> tuple[float, float]:
    """Return how long a chain took over ROS, and what the executor predicted, both in s."""
    from ator_ros.nodes.conversions import chain_of

    client.place(trial.world)
    run = client.execute(chain_of(trial.chain, action_set="", frame=_FRAME), refine=False)
    return (float(run.total[1]) if run.success else TIME_LIMIT), float(run.total[0])


if __name__ == "__main__":
    sys.exit(main())
