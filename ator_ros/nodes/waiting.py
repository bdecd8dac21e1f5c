"""Waiting for a condition in a node's asynchronous callbacks."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node
from rclpy.task import Future

from ator_ros.nodes.diagnostics import STEADY

_PERIOD = 0.1  # real s between two checks of awaited conditions


class Waiting:
    """Lets callbacks of a node wait, while the node processes other messages."""

    def __init__(self, node: Node) -> None:
        self._futures: list[Future] = []
        node.create_timer(_PERIOD, self._check, clock=STEADY)

    def _check(self) -> None:
        futures = self._futures
        self._futures = []
        for future in futures:
            future.set_result(None)

    async def until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait until a condition holds, `timeout` real s at most; return whether it does."""
        end = time.monotonic() + timeout
        while not condition() and time.monotonic() < end:
            self._futures.append(Future())
            await self._futures[-1]
        return condition()
