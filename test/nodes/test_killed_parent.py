"""Processes that a command line or a node started end with it, also if it is killed."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from process import PATIENCE, environment
from selection import few

OWN_NODES = """
import signal, sys
from ator_ros.domains.declared import DeclaredServer
from ator_ros.tools.own_nodes import NodeProcesses
signal.signal(signal.SIGINT, signal.default_int_handler)
with NodeProcesses(1) as nodes:
    for name, script in (("polite", "sleep 1000 & echo $$ $! > polite; wait"),
                         ("deaf", "trap '' INT; echo $$ > deaf; sleep 1000; sleep 1000")):
        nodes.start_server(DeclaredServer(command=("sh", "-c", script), folder=sys.argv[1]))
    signal.pause()
"""
WORKERS = """
import os, pathlib, signal, sys, time
from ator_ros.experience.parallel import run_tasks, workers
def task(name):
    pathlib.Path(sys.argv[1], name).write_text(str(os.getpid()))
    time.sleep(1000.0)
signal.signal(signal.SIGINT, signal.default_int_handler)
with workers(2):
    list(run_tasks(task, ["polite", "deaf"]))
"""


def started(folder: Path, count: int) -> list[int]:
    """Return the `count` processes whose numbers are in the files of a folder."""
    end = time.monotonic() + PATIENCE
    found: list[str] = []
    while len(found) < count:
        assert time.monotonic() < end
        time.sleep(0.05)
        found = [word for file in folder.iterdir() for word in file.read_text().split()]
    return list(map(int, found))


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.fixture(params=[(OWN_NODES, 3), (WORKERS, 2)], ids=["own nodes", "workers"])
def family(
    request: pytest.FixtureRequest, tmp_path: Path
) -> Iterator[tuple[subprocess.Popen[bytes], list[int]]]:
    """Yield a process, and the processes that it started."""
    script, count = request.param
    command = [sys.executable, "-c", script, str(tmp_path)]
    parent = subprocess.Popen(command, env=environment(), stderr=subprocess.DEVNULL)
    children: list[int] = []
    try:
        children += started(tmp_path, count)
        yield parent, children
    finally:
        parent.kill()
        parent.wait()
        for child in filter(runs, children):
            os.kill(child, signal.SIGKILL)


@pytest.mark.parametrize("number", few([signal.SIGKILL, signal.SIGINT], signal.SIGKILL))
def test_children_end_with_their_parent(
    family: tuple[subprocess.Popen[bytes], list[int]], number: signal.Signals
) -> None:
    parent, children = family
    assert all(map(runs, children))
    parent.send_signal(number)
    parent.wait()
    end = time.monotonic() + PATIENCE
    while any(map(runs, children)):
        assert time.monotonic() < end, children
        time.sleep(0.1)


def test_a_round_of_learning_ends_if_its_node_was_killed_before_it_began(tmp_path: Path) -> None:
    with subprocess.Popen(["true"]) as node:
        node.wait()
    settings = dict.fromkeys(("domain", "robot", "map", "planner", "frame", "models", "time"), "")
    argument = json.dumps({**settings, "learned": str(tmp_path), "parent": str(node.pid)})
    command = [sys.executable, "-m", "ator_ros.nodes.learning_process", argument]
    # in a session of its own, whose priority it lowers
    done = subprocess.run(
        command,
        env=environment(),
        stderr=subprocess.DEVNULL,
        timeout=60,
        start_new_session=True,
        check=False,
    )
    assert done.returncode == -signal.SIGKILL
