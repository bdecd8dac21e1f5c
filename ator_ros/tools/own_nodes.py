"""Start the nodes of this package on an unused ROS domain."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Self

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from ator_ros.actions import TIME_LIMIT
from ator_ros.bases.description import Robot
from ator_ros.domains.declared import DeclaredServer
from ator_ros.domains.domain import Domain, domain_for
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.nodes.main_loop import uninterrupted
from ator_ros.nodes.network import (
    RANGE,
    THIS_MACHINE,
    NodesError,
    free_domain,
    stay_on_this_machine,
)
from ator_ros.view.backend import Backend

_ODOM_TIMEOUT = 2.0  # real s; longer than on a robot, for busy machines
_DEADLINE = 1.0  # s of CPU time; the longest chains of the domains need less
_REFINEMENT_TIMEOUT = 30.0  # real s; in which a busy machine has searched for that deadline
_ANSWER_TIMEOUT = 120.0  # real s
_SHUTDOWN_TIMEOUT = 5.0  # real s after which nodes are killed
# Reads the numbers of process groups. When its input ends, as the process that writes it has ended,
# it ends these groups.
_WATCHER = f"""
while read -r group; do groups="$groups -$group"; done
kill -s INT -- $groups
sleep {_SHUTDOWN_TIMEOUT:g}
kill -s KILL -- $groups
"""


class NodeProcesses:
    """Starts nodes on a ROS domain.

    A context manager: all of them, with the processes that they started, end with the block, and
    also if this process is killed. Nodes may be programs of other packages, so that a shell script
    watches for that; `experience.parallel.end_with_parent` does so inside of our own processes.
    """

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self._environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"}
        self._logs = tempfile.TemporaryDirectory(prefix="ator_ros_")
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, parameters: Mapping[str, object], *, namespace: str = "") -> None:
        """Start an executable of this package with these parameters; raises NodesError."""
        words = [_executable("ator_ros", name, "nodes"), "--ros-args"]
        words += ["-r", f"__ns:=/{namespace}"] if namespace else []
        for key, value in parameters.items():
            words += ["-p", f"{key}:={value}"]
        self._run(f"{namespace}/{name}".strip("/"), words)

    def start_server(self, server: DeclaredServer) -> None:
        """Start an action server of a domain; raises NodesError."""
        words = server.command or [_executable(server.package, server.executable)]
        try:
            self._run(server.name, words, server.folder or None)
        except OSError as error:
            where = "command" if server.command else f"executable of {server.package}"
            raise NodesError(
                f"servers: {where}: expected a program, got {server.name}: {error.strerror}"
            ) from error

    def _run(self, name: str, words: Sequence[str], folder: str | None = None) -> None:
        with self._log(name).open("wb") as log:
            process = subprocess.Popen(
                words,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                # a process group of its own: Ctrl-C reaches only this process, which stops it
                start_new_session=True,
            )
        self._processes[name] = process
        assert self._watcher.stdin is not None
        self._watcher.stdin.write(f"{process.pid}\n".encode())

    def check(self) -> None:
        """Raise NodesError with the last output of a node that has ended."""
        # a KeyboardInterrupt inside `poll` may leave a lock on which `wait` blocks
        with uninterrupted():
            codes = {name: process.poll() for name, process in self._processes.items()}
        for name, code in codes.items():
            if code is not None:
                text = self._log(name).read_text(encoding="utf-8", errors="replace")
                last = " | ".join(text.strip().splitlines()[-5:])
                raise NodesError(f"the node {name} ended with exit code {code}: {last}")

    def _log(self, name: str) -> Path:
        return Path(self._logs.name, f"{name.replace('/', '_')[:100]}.log")

    def __enter__(self) -> Self:
        self._watcher = subprocess.Popen(
            ["sh", "-c", _WATCHER],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            start_new_session=True,
        )
        return self

    def __exit__(self, *_: object) -> None:
        """Interrupt the process groups of all nodes in reverse order, and kill what remains."""
        with uninterrupted():  # a second signal (`timeout` sends two) must not leave nodes
            processes = list(reversed(self._processes.values()))
            for process in processes:
                _signal_group(process, signal.SIGINT)
            end = time.monotonic() + _SHUTDOWN_TIMEOUT
            for process in processes:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(timeout=max(0.0, end - time.monotonic()))
                _signal_group(process, signal.SIGKILL)
                process.wait()
            self._watcher.kill()
            self._watcher.communicate()
            self._logs.cleanup()


def _signal_group(leader: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """Send a signal to a process and to those that it started, which may outlive it."""
    with suppress(ProcessLookupError):  # all of them have ended
        os.killpg(leader.pid, number)


def _executable(package: str, name: str, where: str = "servers") -> str:
    """Return the path of an installed executable; messages begin with `where`."""
    try:
        file = Path(get_package_prefix(package), "lib", package, name)
    except (PackageNotFoundError, OSError) as error:  # OSError: no workspace is sourced
        raise NodesError(
            f"{where}: expected an installed package, got {package}: source the workspace that "
            "contains it"
        ) from error
    if not os.access(file, os.X_OK):
        raise NodesError(f"{where}: expected an executable of {package}, got {name}")
    return str(file)


@contextmanager
def unused_domain() -> Iterator[NodeProcesses]:
    """Yield processes of nodes on a ROS domain that has none, and that other machines do not reach.

    Raises RuntimeError if all domains are in use.
    """
    os.environ[RANGE] = THIS_MACHINE
    stay_on_this_machine(os.environ)
    with free_domain() as number, NodeProcesses(number) as nodes:
        yield nodes


@contextmanager
def all_nodes(
    real_time_factor: float,
    source: ToolsetSource,
    simulated: Mapping[str, object] | None = None,
    executed: Mapping[str, object] | None = None,
) -> Iterator[NodeProcesses]:
    """Start simulation, refinement, executor and action servers on an unused ROS domain.

    `simulated` and `executed` are further parameters of simulation and executor. Raises NodesError
    if an executable is not installed.
    """
    domain = domain_for(source.domain, source.robot)
    setting = {"robot": source.robot, "domain": source.domain, "map": source.map}
    named = {name: value for name, value in setting.items() if value}
    models = {"models": source.models} if source.models else {}
    with unused_domain() as nodes:
        pace = {"real_time_factor": real_time_factor, "command_wait": 1.0}
        nodes.start("simulation", {**named, **pace, **(simulated or {})})
        # The robot stands while the executor waits for the answer.
        nodes.start("refinement", {**named, **models, "deadline": _DEADLINE})
        limits = {
            "odom_timeout": _ODOM_TIMEOUT,
            "refinement_timeout": _REFINEMENT_TIMEOUT,
            # As long as in a simulation without ROS, and at least the executor's default.
            "action_timeout": max(TIME_LIMIT, domain.time_limit),
        }
        nodes.start("executor", {**named, **models, **limits, **(executed or {})})
        for server in domain.servers:
            nodes.start_server(server)
        yield nodes


@contextmanager
def connected(
    nodes: NodeProcesses, domain: Domain, robot: Robot, servers: Sequence[str]
) -> Iterator[Backend]:
    """Yield a client of started nodes once these and the action `servers` are available."""
    backend = Backend(
        domain, robot, ros_domain=nodes.domain, check=nodes.check, start_timeout=_ANSWER_TIMEOUT
    )
    with closing(backend):
        backend.ready(simulated=True)
        where = (
            f"on ROS_DOMAIN_ID {nodes.domain}, where only ator_ros and the domain's `servers` are "
            "started"
        )
        for name in servers:
            available = functools.partial(backend.node.count_services, f"{name}/_action/send_goal")
            backend.until(available, f"the action {name} {where}")
        yield backend
