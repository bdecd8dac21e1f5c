"""A node that a thread spins, for programs that ask and wait for the answers."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from ator_ros.nodes.meeting import meeting_client, nobodys_goal
from ator_ros.nodes.spinning import Spinning
from ator_ros.viewing.stage import StageError

_POLL = 0.002
_LONG = 20.0  # s
_CHECK_PERIOD = 0.1
_AGAIN = 3.0
"""Real s after which a service that has not answered is asked again: see `ator_ros.nodes.meeting`."""


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
    fails : type
        Of the error that is raised when something does not come in time, or a service says that it failed.

    Raises
    ------
    fails
        The ROS arguments are none.
    """

    def __init__(
        self,
        name: str,
        *,
        domain: int | None = None,
        words: Sequence[str] = (),
        check: Callable[[], None] = lambda: None,
        patience: float = 10.0,
        fails: type[RuntimeError] = StageError,
    ) -> None:
        self._check, self.patience, self._fails = check, patience, fails
        self._context = rclpy.Context()
        try:
            self._context.init(args=list(words), domain_id=domain)
            self.node = Node(name, context=self._context)
        except RuntimeError as error:  # of rcl, in several lines
            raise fails(
                f"expected arguments of ROS, got {list(words)}: {' '.join(str(error).split())}"
            ) from error
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._spinning = Spinning(self._executor)

    def start(self) -> None:
        """Spin from now on: everything that the node offers and listens to is there."""
        self._spinning.start()

    def meet(self, action: str) -> None:
        """Wait until the server of an action knows this node, whose ActionClient was made before."""
        client = meeting_client(self.node, action)
        self.until(client.service_is_ready, f"the action {action}")
        self._asked(client, nobodys_goal())

    def call(self, client: Any, request: Any) -> Any:
        """Call a service that is there and return its answer; raise where that says that it failed.

        The request must be idempotent, because it may be sent again.
        """
        self._expect(client)
        answer = self._asked(client, request)
        if not getattr(answer, "success", True):
            raise self._fails(f"{client.srv_name}: {answer.message}")
        return answer

    def sent(self, client: Any, request: Any) -> Future:
        """Call a service that is there; do not wait for the answer."""
        self._expect(client)
        future: Future = client.call_async(request)
        return future

    def _expect(self, client: Any) -> None:
        if not client.service_is_ready():
            raise self._fails(f"expected the service {client.srv_name}, it is not there")

    def _asked(self, client: Any, request: Any) -> Any:
        end = time.monotonic() + self.patience
        while True:
            future = client.call_async(request)
            if self._arrives(future, min(end, time.monotonic() + _AGAIN)):
                return future.result()
            client.remove_pending_request(future)
            self._checked(end, f"an answer of the service {client.srv_name}")

    def within(self, ask: Callable[[], Future]) -> Future:
        """Send from the spinning thread: rclpy loses answers that arrive before the call returns."""
        task = self._executor.create_task(ask)
        self.until(task.done, "the thread that spins")
        asked: Future = task.result()
        return asked

    def answer(self, future: Future, what: str) -> Any:
        """Wait for an answer; raise if it does not come."""
        end = time.monotonic() + self.patience
        while not self._arrives(future, end):
            self._checked(end, f"an answer of {what}")
        return future.result()

    def _arrives(self, future: Future, end: float) -> bool:
        """Wait until `end` for an answer, and return whether it came."""
        arrived = threading.Event()
        future.add_done_callback(lambda _: arrived.set())
        while not arrived.wait(_CHECK_PERIOD):
            self._check()
            if time.monotonic() > end:
                return False
        return True

    def until(self, happened: Callable[[], bool], what: str) -> None:
        """Wait until something has happened, and say so where that takes long; raise if it does not."""
        began = time.monotonic()
        told = began + _LONG
        while not happened():
            self._checked(began + self.patience, what)
            if time.monotonic() > told:
                told = math.inf
                self.node.get_logger().warning(f"waiting for {what}")
            time.sleep(_POLL)

    def _checked(self, end: float, what: str) -> None:
        self._check()
        if time.monotonic() > end:
            raise self._fails(f"expected {what} within {self.patience:g} s, it did not come")

    def close(self) -> None:
        """Leave the graph."""
        self._spinning.end()
        self.node.destroy_node()
        self._context.try_shutdown()
