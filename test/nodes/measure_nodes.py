"""Measure the nodes: start, help, what they take when idle, and whether a view or learning slows them.

By hand, on an idle machine: ``scripts/run python test/nodes/measure_nodes.py``; see docs/experiments.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.task import Future
from std_srvs.srv import Trigger

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from chain_client import ChainClient, chain_of_the_paper
from free_port import free_port
from geometry_msgs.msg import Twist
from measure_view import share
from process import PATIENCE, Process, Processes
from ros_client import Client
from stored import episodes, stored
from view.viser_client import ViserClient

from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose
from ator_ros.learning.sets import RECORDS
from ator_ros.nodes.network import free_domain, stay_on_this_machine
from ator_ros.nodes.qos import COMMANDS, RESULTS, SENSOR_DATA

_NODES = ("simulation", "refinement", "executor", "learning", "goal_pose")
_START = Pose(-2.0, 0.0, 0.0)
_PATIENCE = 0.2
"""Real s after which a request is sent again."""
_SETTLED = 3.0
"""Real s after which a node that has started is idle."""


def helped(name: str) -> tuple[float, float]:
    """Return the real and the processor time in s that ``--help`` of a node takes."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    command = [Path(os.environ["ATOR_ROS_ROOT"], "install", "lib", "ator_ros", name), "--help"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - began, spent


def started(processes: Processes, client: Client, name: str, folder: str) -> tuple[Process, float]:
    """Start a node; return it, and the real s until it has answered a request."""
    began = time.monotonic()
    process = processes.start(name, **({"learned": folder} if name == "learning" else {}))
    asked = client.node.create_client(GetParameters, f"{name}/get_parameters")
    assert asked.wait_for_service(PATIENCE)
    answers: list[Future] = []

    def answered() -> bool:  # a server drops the answer to a client that it does not know yet
        if time.monotonic() > began + _PATIENCE * len(answers):
            answers.append(asked.call_async(GetParameters.Request(names=["use_sim_time"])))
        return any(answer.done() for answer in answers)

    client.eventually(answered, f"an answer of {name}")
    return process, time.monotonic() - began


class Reactions:
    """The times in real s from odometry to the command that answers it, as heard here."""

    def __init__(self, client: Client) -> None:
        self.heard: list[tuple[float, bool]] = []
        self.told: dict[str, str] = {}
        client.node.create_subscription(Odometry, "odom", lambda _: self._hear(command=False), SENSOR_DATA)
        client.node.create_subscription(Twist, "cmd_vel", lambda _: self._hear(command=True), COMMANDS)
        client.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear_diagnostics, RESULTS)

    def _hear_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/executor":
                self.told = {value.key: value.value for value in status.values}

    def _hear(self, *, command: bool) -> None:
        self.heard.append((time.monotonic(), command))

    def of(self, chains: ChainClient, count: int) -> np.ndarray:
        """Execute chains one after another; return the times."""
        self.heard.clear()
        for _ in range(count):
            chains.ros.place(robot=_START, ball=(0.0, 0.0))
            chains.until_newer()
            outcome = chains.send(chain_of_the_paper(), refine=True).outcome()
            assert outcome.code == Outcome.SUCCEEDED, outcome.reason
        return np.array([b[0] - a[0] for a, b in pairwise(self.heard) if b[1] and not a[1]])


@contextmanager
def watched(domain: int) -> Iterator[None]:
    """Show the nodes of a domain to one client that looks on."""
    port = free_port()
    command = [sys.executable, "-m", "ator_ros.tools.view", "--attach", "--port", str(port)]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"}
    view = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
    assert view.stdout is not None
    try:
        assert any("http" in line for line in view.stdout)
        client = ViserClient(port)
        client.look()
        client.until(lambda: "/robot" in client.scene, "the robot")
        yield
        client.close()
    finally:
        view.terminate()
        view.wait()


@contextmanager
def learning(client: Client) -> Iterator[None]:
    """Let the node `learning` learn, round after round."""
    learn_now, ended = client.node.create_client(Trigger, "learning/learn_now"), threading.Event()

    def ask() -> None:
        while not ended.wait(_PATIENCE):
            learn_now.call_async(Trigger.Request())

    asking = threading.Thread(target=ask)
    asking.start()
    try:
        yield
    finally:
        ended.set()
        asking.join()


def tell(name: str, reactions: Reactions, chains: ChainClient, count: int) -> None:
    """Execute chains; print quantiles of the reaction times, and what the executor says of its ticks."""
    times = reactions.of(chains, count)
    time.sleep(_SETTLED)  # until the executor has told of the last tick
    middle, late = 1e3 * np.quantile(times, [0.5, 0.99])
    inside = "; ".join(f"{key}: {value}" for key, value in reactions.told.items() if key.startswith("99 %"))
    print(f"{name}: {middle:.1f} ms, 99 % within {late:.1f} ms ({len(times)} ticks); {inside}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each idle node (default: 20)")
    parser.add_argument("--chains", type=int, default=5, help="with and without a view (default: 5)")
    parser.add_argument("--records", type=int, default=10_000, help="to learn from (default: 10000)")
    options = parser.parse_args()
    stay_on_this_machine(os.environ)  # the client announces itself as often as the nodes do
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores", flush=True)
    for name in _NODES:
        real, spent = min(helped(name) for _ in range(3))
        print(f"{name} --help: {real:.2f} s, {spent:.2f} s of processor", flush=True)
    with free_domain() as domain, tempfile.TemporaryDirectory() as folder:
        stored(Path(folder) / RECORDS, episodes(options.records)).close()
        processes, client = Processes(domain, Path(folder)), Client(domain)
        try:
            running = {}
            for name in _NODES:
                running[name], took = started(processes, client, name, folder)
                print(f"{name}: answers after {took:.2f} s", flush=True)
            time.sleep(_SETTLED)
            for name, process in running.items():
                print(f"{name}, idle: {share(process.pid, options.seconds):.1f} % of a core", flush=True)
            reactions, chains = Reactions(client), ChainClient(client)
            reactions.of(chains, 1)
            tell("odom to cmd_vel", reactions, chains, options.chains)
            with watched(domain):
                tell("with a view   ", reactions, chains, options.chains)
            tell("without again ", reactions, chains, options.chains)
            with learning(client):
                tell("while it learns", reactions, chains, options.chains)
            tell("without again ", reactions, chains, options.chains)
        finally:
            client.close()
            processes.kill()


if __name__ == "__main__":
    main()
