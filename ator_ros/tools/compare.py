"""Execute the same chains over ROS and in the tools, and tell how far their durations differ."""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ator_ros.experience.table import library_versions
from ator_ros.experiments.execution import TIME_LIMIT, run_chain
from ator_ros.experiments.toolset import ToolsetSource, make_toolset
from ator_ros.experiments.trials import Trial, random_trial
from ator_ros.files import portable_command, write_text
from ator_ros.nodes.machine import MachineError
from ator_ros.robot import load_robot
from ator_ros.tools.command_line import INTERRUPTED, destination, whole
from ator_ros.tools.processes import NodeEndedError, all_nodes
from ator_ros.tops.library import TopLibrary

LIMIT_PERCENT = 2.0
"""How far the mean durations may be apart."""
_FRAME = "odom"


def arguments() -> argparse.ArgumentParser:
    """Give the command line of `compare`."""
    parser = argparse.ArgumentParser(prog="compare", description=__doc__)
    parser.add_argument("--situations", type=whole(1), default=50, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=whole(), default=941, help="of the situations (default: %(default)s)")
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
    pairs: list[tuple[float, float]] = []
    try:
        for number, pair in enumerate(_pairs(options), start=1):
            print(f"{number} of {options.situations}: over ROS {pair[0]:.2f} s, in the tools {pair[1]:.2f} s")
            pairs.append(pair)
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
        **summary(pairs),
        "versions": library_versions(),
        "machine": platform.platform(),
    }
    write_text(options.out, json.dumps(result, indent=1) + "\n")
    print(f"means differ by {result['difference_percent']:.2f} %; wrote {options.out}")
    return 0 if result["met"] else 1


def summary(pairs: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Compare durations in s over ROS and in the tools, those of failed chains at the time limit."""
    ros, tools = (statistics.fmean(column) for column in zip(*pairs, strict=True))
    apart = [over_ros - in_tools for over_ros, in_tools in pairs]
    percent = 100.0 * (ros / tools - 1.0)
    return {
        "situations": len(pairs),
        "mean_ros_s": round(ros, 3),
        "mean_tools_s": round(tools, 3),
        "difference_percent": round(percent, 3),
        "limit_percent": LIMIT_PERCENT,
        "met": abs(percent) <= LIMIT_PERCENT,
        "same_to_the_tick": sum(abs(difference) < 1e-6 for difference in apart),
        "differences_s": [round(difference, 3) for difference in apart],
    }


def _pairs(options: argparse.Namespace) -> Iterator[tuple[float, float]]:
    """Start the nodes and execute the situations one by one; give both durations in s."""
    from ator_ros.tools.demo_client import DemoClient

    robot = load_robot()
    library, refiner = TopLibrary(robot), make_toolset(ToolsetSource()).refiner(gated=True)
    with all_nodes(options.real_time_factor) as nodes, DemoClient(nodes.domain, nodes.check) as client:
        client.ready()
        for index in range(options.situations):
            trial = random_trial(options.seed, index, "dribble", robot, library)
            naive = refiner.naive(trial.world, trial.chain)
            chain = refiner.refine(trial.world, naive).chain
            run = run_chain(robot, library, trial.world, chain)
            yield _over_ros(client, Trial(index, trial.world, chain)), run.duration


def _over_ros(client: Any, trial: Trial) -> float:
    from ator_ros.nodes.conversions import chain_of

    client.place(trial.world)
    run = client.execute(chain_of(trial.chain, action_set="", frame=_FRAME), refine=False)
    return float(run.total[1]) if run.success else TIME_LIMIT


if __name__ == "__main__":
    sys.exit(main())
