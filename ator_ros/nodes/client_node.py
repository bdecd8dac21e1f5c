"""The node of a program that asks other nodes and shows what they publish, such as `view`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ator_ros.nodes.main_loop import uninterrupted
from ator_ros.nodes.network import NodesError

_SPIN = 0.02  # real s


class ClientNode:
    """A node that is spun while its program waits.

    Attributes
    ----------
    node : Node
        In a context of its own.
    timeout : float
        Real s for which `until` waits, unless it is told otherwise.

    Parameters
    ----------
    name : str
        Name of the node.
    arguments : sequence of str
        ROS arguments, such as the namespace of a robot's nodes; raises NodesError if ROS refuses
        them.
    ros_domain : int, optional
        By default that of the environment.
    check : callable
        Called while messages are processed; raises an error to stop that.
    timeout : float
    """

    def __init__(
        self,
        name: str,
        *,
        arguments: Sequence[str] = (),
        ros_domain: int | None = None,
        check: Callable[[], None] = lambda: None,
        timeout: float = 60.0,
    ) -> None:
        self.timeout = timeout
        self._check = check
        self._context = rclpy.Context()
        try:
            self._context.init(args=list(arguments), domain_id=ros_domain)
            self.node = Node(name, context=self._context)
        except RuntimeError as error:  # rcl's message has several lines
            text = " ".join(str(error).split())
            raise NodesError(f"expected arguments of ROS, got {list(arguments)}: {text}") from error
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Process messages for some real s."""
        self._check()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._spin_once(min(seconds, _SPIN))

    def until(
        self, condition: Callable[[], object], what: str, timeout: float | None = None
    ) -> None:
        """Process messages until a condition holds; raises NodesError after `timeout` real s."""
        timeout = self.timeout if timeout is None else timeout
        end = time.monotonic() + timeout
        while not condition():
            self._check()
            if time.monotonic() > end:
                raise NodesError(f"expected {what} within {timeout:g} s, got nothing")
            self._spin_once(_SPIN)

    def _spin_once(self, seconds: float) -> None:
        with uninterrupted():
            self._executor.spin_once(timeout_sec=seconds)
