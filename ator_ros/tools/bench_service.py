"""The round trip of refine_subgoal, next to an empty service of the same types.

As a program, ``python -m ator_ros.tools.bench_service``, this is the empty service.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from ator_interfaces.srv import RefineSubgoal
from ator_ros.experiments.trials import random_trial
from ator_ros.nodes.conversions import chain_of, situation_of
from ator_ros.nodes.running import run_node
from ator_ros.robot import load_robot
from ator_ros.tools.processes import own_nodes
from ator_ros.tops.library import TopLibrary

EMPTY = "empty_refine_subgoal"
SEED = 802
LIMIT_RATIO, LIMIT_P99_MS = 1.5, 5.0
_WARM_UP = 20
_PATIENCE = 40.0


def empty_service() -> Node:
    """Make a node that answers every request at once, with nothing."""
    node = Node("empty_service")
    node.create_service(RefineSubgoal, EMPTY, lambda _, response: response)
    return node


def measure(requests: int = 1000) -> dict[str, float]:
    """Give medians, 99th percentiles and the node's growth of memory over `requests` requests.

    Both services are asked in turn, by a thread beside the one that spins.
    """
    with own_nodes() as nodes:
        nodes.start("refinement", {})
        environment = {**os.environ, "ROS_DOMAIN_ID": str(nodes.domain)}
        empty = subprocess.Popen([sys.executable, "-m", "ator_ros.tools.bench_service"], env=environment)
        try:
            return _measured(nodes.domain, nodes.pid("refinement"), requests)
        finally:
            empty.terminate()
            empty.wait()


def _measured(domain: int, pid: int, requests: int) -> dict[str, float]:
    context = rclpy.Context()
    context.init(domain_id=domain)
    node = Node("bench", context=context)
    clients = [node.create_client(RefineSubgoal, name) for name in (EMPTY, "refine_subgoal")]
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spinning = threading.Thread(target=_spin, args=(executor,), daemon=True)
    spinning.start()
    try:
        for client in clients:
            if not client.wait_for_service(timeout_sec=_PATIENCE):
                raise RuntimeError(f"expected the service {client.srv_name} within {_PATIENCE:g} s")
        _times(clients, _WARM_UP, 0)
        before = resident_mib(pid)
        empty, ours = _times(clients, requests, _WARM_UP)
        growth = resident_mib(pid) - before
    finally:
        executor.shutdown()
        spinning.join()
        node.destroy_node()
        context.try_shutdown()
    medians = statistics.median(empty), statistics.median(ours)
    return {
        "requests": requests,
        "empty_median_ms": round(medians[0], 3),
        "median_ms": round(medians[1], 3),
        "ratio": round(medians[1] / medians[0], 2),
        "limit_ratio": LIMIT_RATIO,
        "empty_p99_ms": round(statistics.quantiles(empty, n=100)[-1], 3),
        "p99_ms": round(statistics.quantiles(ours, n=100)[-1], 3),
        "limit_p99_ms": LIMIT_P99_MS,
        "memory_growth_mib": round(growth, 2),
    }


def _times(clients: list[Any], count: int, first: int) -> list[list[float]]:
    """Ask each client `count` times; give the times of each in ms."""
    robot = load_robot()
    library = TopLibrary(robot)
    times: list[list[float]] = [[] for _ in clients]
    for index in range(first, first + count):
        trial = random_trial(SEED, index, "dribble", robot, library)
        request = RefineSubgoal.Request(
            situation=situation_of(trial.world, frame="odom"),
            chain=chain_of(trial.chain, action_set="", frame="odom"),
        )
        for client, taken in zip(clients, times, strict=True):
            began = time.perf_counter()
            client.call(request, timeout_sec=_PATIENCE)
            taken.append(1000.0 * (time.perf_counter() - began))
    return times


def _spin(executor: SingleThreadedExecutor) -> None:
    try:
        executor.spin()
    except ExternalShutdownException:
        return


def resident_mib(pid: int) -> float:
    """Give the resident memory of a process in MiB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


if __name__ == "__main__":
    run_node(empty_service)
