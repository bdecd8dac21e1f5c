"""Play chains of a domain naive and refined, over ROS (paper, Figure 1)."""

from __future__ import annotations

import argparse
import dataclasses
import signal
import sys
from collections.abc import Iterator

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.trials import Trial, open_speeds, random_trial
from ator_ros.robot.description import Robot
from ator_ros.tools.guard import INTERRUPTED, ending_signals, expected_errors, handled, report, write_plainly
from ator_ros.tools.processes import all_nodes, node_setting
from ator_ros.tools.work.demo_report import PICTURE, DemoSituation, explanation, save_picture, table

_FRAME = "odom"


def run(options: argparse.Namespace, domain: Domain) -> int:
    """Do what the command line asks for; return the exit code."""
    write_plainly()
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        print(f"demo: {error}: source your ROS 2 workspace, or use make demo", file=sys.stderr)
        return 1
    played: list[DemoSituation] = []
    code = 0
    try:
        robot = domain.robot(options.robot or None)
        with handled(dict.fromkeys(ending_signals(), signal.default_int_handler)):
            played.extend(_play(options, domain, robot))  # also a background job can be stopped
    except KeyboardInterrupt:
        print("interrupted")
        code = INTERRUPTED
    except expected_errors() as error:
        report("demo", error)
        code = 1
    if played:
        print(f"\n{table(played)}")
        save_picture(options.out, robot, played)
        print(f"\n{options.out.resolve()}: {PICTURE}\nmake view shows it live, in the browser")
    return code


def _play(options: argparse.Namespace, domain: Domain, robot: Robot) -> Iterator[DemoSituation]:
    """Start the nodes and play the situations one by one."""
    from ator_ros.tools.work.demo_client import DemoClient

    library = domain.library(robot)
    started = " and ".join(("three nodes", *(program.name for program in domain.programs)))
    with all_nodes(options.real_time_factor, **node_setting(options)) as nodes:
        print(f"{started} start on ROS domain {nodes.domain} …", flush=True)
        with DemoClient(nodes.domain, nodes.check, domain.objects) as client:
            client.ready(domain.remote_servers(), len(domain.programs))
            for index in range(options.situations):
                trial = random_trial(domain, options.chain, library, seed=options.seed, index=index)
                if "speed" in domain.variables:
                    trial = dataclasses.replace(trial, chain=open_speeds(trial.chain))
                if index == 0:
                    print(explanation(options.chain, trial.chain, domain.presentation.chains), flush=True)
                yield _both(client, trial, f"situation {index + 1} of {options.situations}")


def _both(client: object, trial: Trial, name: str) -> DemoSituation:
    """Play one situation naive and refined."""
    from ator_ros.nodes.messages import chain_of
    from ator_ros.tools.work.demo_client import DemoClient, predicted_as

    assert isinstance(client, DemoClient)
    message = chain_of(trial.chain, action_set="", frame=_FRAME)
    answer = client.refine(trial.world, message)
    client.place(trial.world)
    print(f"{name}: naive ", end="", flush=True)
    naive = predicted_as(client.execute(answer.original, refine=False), answer.before, answer.before_actions)
    client.place(trial.world)
    print(f"{naive.total[1]:.2f} s, refined ", end="", flush=True)
    refined = client.execute(message, refine=True)
    if refined.refined:
        refined = predicted_as(refined, answer.after, answer.after_actions)
    else:
        refined = predicted_as(refined, answer.before, answer.before_actions)
    print(f"{refined.total[1]:.2f} s", flush=True)
    return DemoSituation(trial.world, trial.chain, naive, refined)
