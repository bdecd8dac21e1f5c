"""Our nodes as processes on a ROS domain of their own; all of them are ended with the block."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType, TracebackType

from ator_ros.actions import TIME_LIMIT
from ator_ros.domains.declared import DeclaredServer
from ator_ros.domains.domain import domain_for
from ator_ros.nodes.network import RANGE, THIS_MACHINE, free_domain, stay_on_this_machine

# The executor waits so long, in s, for odometry and refinement: more than on a robot, for machines that are
# busy.
_EXECUTOR_PATIENCE = 2.0
_NO_SETTINGS: Mapping[str, object] = MappingProxyType({})
_UNHURRIED = 1.0  # s that refinement may take, less than the executor's patience


class NodesError(RuntimeError):
    """Nodes did not do what a tool needs of them; the message says what is missing."""


class NodeEndedError(NodesError):
    """A node that has ended by itself; the message holds the end of its output."""


class NodeProcesses:
    """Starts nodes; as a context manager it ends all of them when the block ends, whatever the reason.

    Parameters
    ----------
    folder : Path
        Where the executables lie, lib/ator_ros of an installation.
    domain : int
        ROS domain.
    patience : float
        Time in s that the nodes have for ending before they are forced to.
    """

    def __init__(self, folder: Path, domain: int, *, patience: float = 5.0) -> None:
        self.domain = domain
        self._folder = folder
        self._patience = patience
        self._environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            RANGE: THIS_MACHINE,
            "PYTHONUNBUFFERED": "1",
        }
        self._logs = tempfile.TemporaryDirectory(prefix="ator_ros_")
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, parameters: Mapping[str, object], folder: Path | None = None) -> None:
        """Start the executable `name`, in `folder` where it is of another package, with these parameters."""
        arguments = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
        words = [str((folder or self._folder) / name), *(["--ros-args", *arguments] if arguments else [])]
        self._run(name, words, None)

    def start_server(self, server: DeclaredServer) -> None:
        """Start an action server of a domain.

        Raises
        ------
        NodesError
            It is not installed, or cannot be started.
        """
        if not server.command:
            self.start(server.executable, {}, folder_of(server))
            return
        try:
            self._run(server.name, server.words, server.folder)
        except OSError as error:
            raise NodesError(
                f"servers: command: expected a program, got {server.name}: {error.strerror}"
            ) from error

    def _run(self, name: str, words: Sequence[str], folder: str | None) -> None:
        with self._log(name).open("wb") as log:
            self._processes[name] = subprocess.Popen(
                words,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                # Ctrl-C goes to this process only, which ends the nodes in order.
                start_new_session=True,
            )

    def pid(self, name: str) -> int:
        """Return the process id of the executable `name`."""
        return self._processes[name].pid

    def check(self) -> None:
        """Make sure that all are running.

        Raises
        ------
        NodeEndedError
            One is not.
        """
        for name, process in self._processes.items():
            if process.poll() is not None:
                lines = self._log(name).read_text(encoding="utf-8", errors="replace").strip().splitlines()
                raise NodeEndedError(
                    f"the node {name} ended with exit code {process.returncode}: {' | '.join(lines[-5:])}"
                )

    def stop(self) -> None:
        """End all in reverse order, as Ctrl-C would, and kill those that do not end."""
        running = [process for process in reversed(self._processes.values()) if process.poll() is None]
        for process in running:
            process.send_signal(signal.SIGINT)
        end = time.monotonic() + self._patience
        for process in running:
            try:
                process.wait(timeout=max(0.0, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._processes.clear()

    def _log(self, name: str) -> Path:
        return Path(self._logs.name, f"{name.replace('/', '_')[:100]}.log")

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A second Ctrl-C, the SIGTERM that `timeout` sends twice, or a terminal that closes must not leave a
        # node behind.
        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        previous = [signal.signal(number, signal.SIG_IGN) for number in numbers]
        try:
            self.stop()
            self._logs.cleanup()
        finally:
            for number, handler in zip(numbers, previous, strict=True):
                signal.signal(number, handler)


@contextmanager
def own_nodes() -> Iterator[NodeProcesses]:
    """Yield the installed nodes on an unused domain that, like ours, is visible on this machine only.

    Raises
    ------
    ImportError
        ROS is not there, or has not been sourced.
    NodesError
        Our nodes are not installed.
    """
    folder = folder_of(DeclaredServer("ator_ros", "executor"), where="nodes")
    os.environ[RANGE] = THIS_MACHINE
    stay_on_this_machine(os.environ)
    with free_domain() as domain, NodeProcesses(folder, domain) as nodes:
        yield nodes


def folder_of(server: DeclaredServer, where: str = "servers") -> Path:
    """Return the folder of an executable; `where` is what asks for it, for messages.

    Raises
    ------
    NodesError
        Its package is not installed, or has no such executable.
    """
    from ament_index_python.packages import PackageNotFoundError, get_package_prefix

    name = server.package
    try:
        folder = Path(get_package_prefix(name), "lib", name)
    except (PackageNotFoundError, OSError) as error:  # OSError: no workspace is sourced
        raise NodesError(
            f"{where}: expected an installed package, got {name}: source the workspace that it is in"
        ) from error
    if not os.access(folder / server.executable, os.X_OK):
        there = sorted(file.name for file in folder.glob("*") if os.access(file, os.X_OK))
        raise NodesError(
            f"{where}: expected an executable of {name} (it has {', '.join(there) or 'none'}), "
            f"got {server.executable}"
        )
    return folder


@contextmanager
def all_nodes(
    real_time_factor: float,
    simulated: Mapping[str, object] = _NO_SETTINGS,
    executed: Mapping[str, object] = _NO_SETTINGS,
    /,
    *,
    models: str = "",
    robot: str = "",
    domain: str = "",
) -> Iterator[NodeProcesses]:
    """Start simulation, refinement, executor and the domain's action servers, with what else is named.

    `simulated` and `executed` are further parameters of simulation and executor.
    """
    of_domain = domain_for(domain, robot)
    for server in of_domain.servers:
        if not server.command:
            folder_of(server)  # before anything starts
    whose = {name: value for name, value in (("robot", robot), ("domain", domain)) if value}
    named = {**whose, **({"models": models} if models else {})}
    with own_nodes() as nodes:
        pace = {"real_time_factor": real_time_factor, "command_wait": 1.0}
        nodes.start("simulation", {**pace, **simulated, **whose})
        # Chains of remote actions are long, and a robot that stands at each station can wait for the answer.
        unhurried = {"deadline": _UNHURRIED} if of_domain.servers else {}
        nodes.start("refinement", {**named, **unhurried})
        patience = {"odom_timeout": _EXECUTOR_PATIENCE, "refinement_timeout": _EXECUTOR_PATIENCE}
        # An action may take what it may in a simulation without ROS, and the executor's default at least.
        limits = {"action_timeout": max(TIME_LIMIT, of_domain.time_limit)}
        nodes.start("executor", {**named, **patience, **limits, **executed})
        for server in of_domain.servers:
            nodes.start_server(server)
        yield nodes
