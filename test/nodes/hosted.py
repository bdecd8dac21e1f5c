"""A node in this process, which starts ten times as fast as a separate process."""

import importlib
import os
from collections.abc import Callable

import rclpy
from process import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from ros_client import SpinThread

from ator_ros.nodes.network import stay_on_this_machine


class Hosted:
    """A node, named by its executable, that spins in a thread until it is closed; one at a time.

    `output` returns the standard output and error since its last call; `words` are other
    ROS arguments, and `parameters` the node's.
    """

    def __init__(
        self,
        name: str,
        domain: int,
        output: Callable[[], str],
        /,
        *words: str,
        **parameters: object,
    ) -> None:
        pairs = ["{}:={}".format(*pair) for pair in parameters.items()]
        words += tuple(word for pair in pairs for word in ("-p", pair))
        stay_on_this_machine(os.environ)
        rclpy.init(
            args=[name, "--ros-args", *words],
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._read, self._output = output, ""
        kind = getattr(
            importlib.import_module(f"ator_ros.nodes.{name}"), f"{name.capitalize()}Node"
        )
        try:
            self.node: Node = kind()
        except BaseException:  # also an exit: the next test needs a context of its own
            rclpy.try_shutdown()
            raise
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        self._spinning = SpinThread(executor)
        self._spinning.start()

    @property
    def running(self) -> bool:
        """Whether the node has not ended with an exception."""
        return self._spinning.is_alive()

    @property
    def output(self) -> str:
        self._output += self._read()
        return self._output

    def close(self) -> None:
        self._spinning.end(PATIENCE)
        self.node.destroy_node()
        rclpy.try_shutdown()
