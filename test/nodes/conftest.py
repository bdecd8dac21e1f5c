"""Fixtures of the node tests: a ROS domain of their own for every test, processes on it, and a client."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import domain_coordinator
import pytest
from process import Process, Processes
from ros_client import Client

Start = Callable[..., Process]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what starts processes."""
    for item in items:
        if "start" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.node)


@pytest.fixture
def domain() -> Iterator[int]:
    """Yield a ROS domain that no other test uses at the same time, in this run or another."""
    with domain_coordinator.domain_id() as number:
        yield number


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Start]:
    """Yield a function that starts executables: start("simulation", namespace="a", real_time_factor=0.0)."""
    processes = Processes(domain, tmp_path)
    yield processes.start
    processes.kill()


@pytest.fixture
def client(domain: int) -> Iterator[Client]:
    """Yield a client in no namespace."""
    made = Client(domain)
    yield made
    made.close()
