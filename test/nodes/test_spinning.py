"""A node that a thread spins, at its end."""

from __future__ import annotations

import threading
import time
from typing import Any

import pytest
from rclpy.executors import SingleThreadedExecutor
from ros_client import Client

from ator_ros.nodes.client_node import ClientNode

pytestmark = pytest.mark.node


@pytest.mark.parametrize("kind", [ClientNode, Client])
def test_a_node_that_is_closed_while_it_looks_for_work_raises_nothing(
    domain: int, monkeypatch: pytest.MonkeyPatch, kind: type
) -> None:
    looks, usual = threading.Event(), SingleThreadedExecutor.can_execute

    def look(executor: SingleThreadedExecutor, entity: Any) -> bool:
        looks.set()
        time.sleep(0.02)  # as on a busy machine
        return bool(usual(executor, entity))

    raised: list[object] = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    monkeypatch.setattr(SingleThreadedExecutor, "can_execute", look)
    own = ClientNode("closed", domain=domain) if kind is ClientNode else Client(domain)
    if isinstance(own, ClientNode):
        own.start()
    assert looks.wait(10.0)
    own.close()
    assert raised == []
