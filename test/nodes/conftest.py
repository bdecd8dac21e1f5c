"""Fixtures of the node tests: a ROS domain of their own for every test, processes on it, and a client."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import domain_coordinator
import pytest
from ros_client import Client, Process

Start = Callable[..., Process]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what starts processes."""
    for item in items:
        if "start" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.node)


@pytest.fixture
def domain() -> Iterator[int]:
    """Give a ROS domain that no other test uses at the same time, in this run or another."""
    with domain_coordinator.domain_id() as number:
        yield number


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Start]:
    """Give a function that starts executables: start("simulation", namespace="a", real_time_factor=0.0)."""
    processes: list[Process] = []

    def run(name: str, *, namespace: str = "", **parameters: object) -> Process:
        arguments = ["--ros-args"]
        for parameter, value in parameters.items():
            arguments += ["-p", f"{parameter}:={value}"]
        if namespace:
            arguments += ["-r", f"__ns:=/{namespace}"]
        process = Process(name, tmp_path / f"{name}{len(processes)}.log", domain, arguments)
        processes.append(process)
        return process

    yield run
    for process in processes:
        process.kill()


@pytest.fixture
def client(domain: int) -> Iterator[Client]:
    """Give a client in no namespace."""
    made = Client(domain)
    yield made
    made.close()
