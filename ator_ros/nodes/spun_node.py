"""A node that a thread spins, for programs that ask and wait for the answers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from ator_ros.viewing.stage import StageError

_POLL = 0.002
_CHECK_PERIOD = 0.1


class SpunNode:
    """A node with its thread.

    Parameters
    ----------
    name : str
        Of the node.
    domain : int, optional
        ROS domain; by default that of the environment.
    words : sequence of str
        ROS arguments, such as remappings.
    check : callable
        Called while something is waited for; raises when waiting makes no sense.
    patience : float
        Real time in s that each thing may take.
    """

    def __init__(
        self,
        name: str,
        *,
        domain: int | None = None,
        words: Sequence[str] = (),
        check: Callable[[], None] = lambda: None,
        patience: float = 10.0,
    ) -> None:
        self._check, self._patience = check, patience
        self._context = rclpy.Context()
        self._context.init(args=list(words), domain_id=domain)
        self.node = Node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def start(self) -> None:
        """Spin from now on: everything that the node offers and listens to is there."""
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def call(self, client: Any, request: Any) -> Any:
        """Call a service and return its answer; raise StageError where that says that it failed."""
        answer = self.answer(self.sent(client, request), client.srv_name)
        if not getattr(answer, "success", True):
            raise StageError(f"{client.srv_name}: {answer.message}")
        return answer

    def sent(self, client: Any, request: Any) -> Future:
        """Call a service that is there; do not wait for the answer."""
        if not client.service_is_ready():
            raise StageError(f"expected the service {client.srv_name}, it is not there")
        future: Future = client.call_async(request)
        return future

    def within(self, ask: Callable[[], Future]) -> Future:
        """Ask in the thread that spins: rclpy's action client loses answers that outrun who asks."""
        task = self._executor.create_task(ask)
        self.until(task.done, "the thread that spins")
        asked: Future = task.result()
        return asked

    def answer(self, future: Future, what: str) -> Any:
        """Wait for an answer; raise StageError if it does not come."""
        arrived = threading.Event()
        future.add_done_callback(lambda _: arrived.set())
        end = time.monotonic() + self._patience
        while not arrived.wait(_CHECK_PERIOD):
            self._checked(end, f"an answer of {what}")
        return future.result()

    def until(self, happened: Callable[[], bool], what: str) -> None:
        """Wait until something has happened; raise StageError if it does not."""
        end = time.monotonic() + self._patience
        while not happened():
            self._checked(end, what)
            time.sleep(_POLL)

    def _checked(self, end: float, what: str) -> None:
        self._check()
        if time.monotonic() > end:
            raise StageError(f"expected {what} within {self._patience:g} s, it did not come")

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        self._context.try_shutdown()
