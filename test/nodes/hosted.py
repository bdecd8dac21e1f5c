"""A node in this process, which starts in a tenth of the time that a process of its own takes."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable

import rclpy
from process import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ator_ros.nodes.client_node import SpinThread
from ator_ros.nodes.network import stay_on_this_machine


class Hosted:
    """A node of ours, named as its executable, that spins in a thread until it is closed; one at a time.

    `said` returns what was written to standard output and error since it was last called; `words` are other
    ROS arguments, and `parameters` the node's.
    """

    def __init__(
        self, name: str, domain: int, said: Callable[[], str], /, *words: str, **parameters: object
    ) -> None:
        pairs = ["{}:={}".format(*pair) for pair in parameters.items()]
        words += tuple(word for pair in pairs for word in ("-p", pair))
        stay_on_this_machine(os.environ)
        rclpy.init(
            args=[name, "--ros-args", *words],
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._said, self._output = said, ""
        made = getattr(importlib.import_module(f"ator_ros.nodes.{name}"), f"{name.capitalize()}Node")
        self.node: Node = made()
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        self._spinning = SpinThread(executor)
        self._spinning.start()

    @property
    def running(self) -> bool:
        """Whether nothing that was raised has ended it."""
        return self._spinning.is_alive()

    @property
    def output(self) -> str:
        """What it has written so far."""
        self._output += self._said()
        return self._output

    def close(self) -> None:
        """Leave the graph."""
        self._spinning.end(PATIENCE)
        self.node.destroy_node()
        rclpy.try_shutdown()
