"""The round trip of refine_subgoal, next to that of services of the same types that do less.

As a program, ``python -m ator_ros.tools.benchmarks.service NAME SOURCE``, this is one of them; SOURCE is a
`ToolsetSource` as JSON.
"""

from __future__ import annotations

import functools
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.toolset import ToolsetSource, make_library, tools_of
from ator_ros.evaluation.trials import random_trial
from ator_ros.nodes import messages
from ator_ros.nodes.messages import answer_of
from ator_ros.nodes.running import run_node
from ator_ros.nodes.spinning import Spinning
from ator_ros.refinement.refiner import Selection, choose
from ator_ros.schema import structured, unstructured
from ator_ros.tools.benchmarks.requests import worst_request
from ator_ros.tools.benchmarks.rows import DelayedTrip, RoundTrip, ServiceTime
from ator_ros.tools.processes import own_nodes

SEED = 802
LIMIT_RATIO, LIMIT_P99_MS = 1.5, 5.0
LIMIT_DELAY_MS = 20.0
"""By how much requests may be delayed by others."""
WORST = "worst_requests"
_FRAME = "odom"
_WARM_UP = 20
_PATIENCE = 40.0
_UNTIL_ASKED = 10.0
REFINE = "refine_subgoal"

Answer = Callable[[RefineSubgoal.Request, RefineSubgoal.Response], RefineSubgoal.Response]
Rows = dict[str, ServiceTime | RoundTrip | DelayedTrip]
"""By name of the case."""


def _empty(_: ToolsetSource) -> Answer:
    return _nothing


def _nothing(_: RefineSubgoal.Request, response: RefineSubgoal.Response) -> RefineSubgoal.Response:
    return response


def _messages_alone(source: ToolsetSource) -> Answer:
    """Return what reads each request and writes a full answer as `refinement` does, but refines only once."""
    tools, library = tools_of(source)
    refiner = tools.refiner()
    known: list[Selection] = []

    def answer(request: RefineSubgoal.Request, _: RefineSubgoal.Response) -> RefineSubgoal.Response:
        world = messages.world_from(request.situation, frame=_FRAME)
        chain = messages.chain_from(request.chain, library, frame=_FRAME)
        objective = messages.objective_from(request.objective)
        if not known:
            known.append(choose(refiner, world, [chain], objective))
        return answer_of(known[0], request, action_set=library.action_set, frame=_FRAME)

    return answer


YARDSTICKS: Mapping[str, Callable[[ToolsetSource], Answer]] = MappingProxyType(
    {"empty": _empty, "messages_alone": _messages_alone}
)
"""Services to compare with: one that answers at once with nothing, one that does all but refine."""


def yardstick(name: str, source: ToolsetSource) -> Node:
    """Make the node of one of the YARDSTICKS; its service has the same name."""
    node = Node(f"{name}_service")
    node.create_service(RefineSubgoal, name, YARDSTICKS[name](source))
    return node


def measure(source: ToolsetSource, requests: int = 1000) -> Rows:
    """Return medians and 99th percentiles, and how the node's memory grows over `requests` requests.

    The last row is of requests beside which another process asks for the worst that there is.

    All services are asked in turn, by a thread beside the one that spins.
    """
    with own_nodes() as nodes:
        nodes.start("refinement", _parameters(source))
        told = json.dumps(unstructured(source))
        environment = {**os.environ, "ROS_DOMAIN_ID": str(nodes.domain)}
        program = [sys.executable, "-m", "ator_ros.tools.benchmarks.service"]
        others = [subprocess.Popen([*program, name, told], env=environment) for name in YARDSTICKS]
        try:
            empty, messages, trip = _measured(source, nodes.domain, nodes.pid("refinement"), requests)
            others.append(subprocess.Popen([*program, WORST, told], env=environment))
            delayed = _delayed(source, nodes.domain, requests, trip.median_ms)
            return {
                "empty": empty,
                "messages alone": messages,
                "round trip": trip,
                "beside worst-case requests": delayed,
            }
        finally:
            for other in others:
                other.terminate()
            for other in others:
                other.wait()


def _parameters(source: ToolsetSource) -> dict[str, str]:
    """Return the parameters of `refinement` that a source stands for; what is empty has its default."""
    named = {"domain": source.domain, "robot": source.robot, "models": source.models}
    return {name: value for name, value in named.items() if value}


def _measured(
    source: ToolsetSource, domain: int, pid: int, requests: int
) -> tuple[ServiceTime, ServiceTime, RoundTrip]:
    """Measure the services that are compared with, and the round trip of a refinement."""
    with _clients(domain, [*YARDSTICKS, REFINE]) as clients:
        _times(source, clients, _WARM_UP, 0)
        before = resident_mib(pid)
        empty, messages, ours = _times(source, clients, requests, _WARM_UP)
        growth = resident_mib(pid) - before
    trip = RoundTrip(
        requests=requests,
        **vars(_row(ours, empty)),
        limit_ratio=LIMIT_RATIO,
        limit_p99_ms=LIMIT_P99_MS,
        memory_growth_mib=round(growth, 2),
    )
    return _row(empty, empty), _row(messages, empty), trip


def _delayed(source: ToolsetSource, domain: int, requests: int, alone: float) -> DelayedTrip:
    """Measure round trips while another client asks one worst-case request after the other."""
    with _clients(domain, [REFINE]) as clients:
        time.sleep(_UNTIL_ASKED)
        (times,) = _times(source, clients, requests, _WARM_UP)
    row = _row(times, times)
    return DelayedTrip(
        requests=requests,
        **vars(row),
        max_ms=round(max(times), 3),
        p99_delay_ms=round(row.p99_ms - alone, 3),
        limit_p99_delay_ms=LIMIT_DELAY_MS,
    )


def _ask_the_worst(source: ToolsetSource) -> None:
    """Ask for all that may be free in the longest chain, again and again, until the process is ended."""
    request = worst_request(source)
    with _clients(int(os.environ["ROS_DOMAIN_ID"]), [REFINE]) as (client,):
        while True:
            client.call(request, timeout_sec=_PATIENCE)


def _row(times: Sequence[float], empty: Sequence[float]) -> ServiceTime:
    median = statistics.median(times)
    return ServiceTime(
        median_ms=round(median, 3),
        p99_ms=round(statistics.quantiles(times, n=100)[-1], 3),
        ratio=round(median / statistics.median(empty), 2),
    )


@contextmanager
def _clients(domain: int, names: Sequence[str]) -> Iterator[list[Any]]:
    """Yield clients of the services `names`, once these are there; a thread spins their node."""
    context = rclpy.Context()
    context.init(domain_id=domain)
    node = Node("bench", context=context)
    clients = [node.create_client(RefineSubgoal, name) for name in names]
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spinning = Spinning(executor)
    spinning.start()
    try:
        for client in clients:
            if not client.wait_for_service(timeout_sec=_PATIENCE):
                raise RuntimeError(f"expected the service {client.srv_name} within {_PATIENCE:g} s")
        yield clients
    finally:
        spinning.end()
        node.destroy_node()
        context.try_shutdown()


def _times(source: ToolsetSource, clients: list[Any], count: int, first: int) -> list[list[float]]:
    """Ask each client `count` times; return the times of each in ms."""
    domain, library = find_domain(source.domain), make_library(source.described(), source)
    times: list[list[float]] = [[] for _ in clients]
    for index in range(first, first + count):
        trial = random_trial(domain, next(iter(domain.chains)), library, seed=SEED, index=index)
        request = RefineSubgoal.Request(
            situation=messages.situation_of(trial.world, frame=_FRAME),
            chain=messages.chain_of(trial.chain, action_set=source.action_set, frame=_FRAME),
        )
        for client, taken in zip(clients, times, strict=True):
            began = time.perf_counter()
            client.call(request, timeout_sec=_PATIENCE)
            taken.append(1000.0 * (time.perf_counter() - began))
    return times


def resident_mib(pid: int) -> float:
    """Return the resident memory of a process in MiB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in (*YARDSTICKS, WORST):
        sys.exit(f"service: expected one of {', '.join((*YARDSTICKS, WORST))}, and a source")
    asked, described = sys.argv.pop(1), structured(json.loads(sys.argv.pop(1)), ToolsetSource)
    if asked == WORST:
        _ask_the_worst(described)
    run_node(functools.partial(yardstick, asked, described))
