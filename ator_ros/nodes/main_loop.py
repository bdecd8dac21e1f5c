"""The main loop of all nodes, and their command line."""

from __future__ import annotations

import gc
import inspect
import os
import re
import signal
import sys
import threading
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.nodes.parameters import Parameter, SetupError
from ator_ros.printable import one_line
from ator_ros.resources import ResourceError

_EMPTY_PARAMETER = re.compile(r"parameter override rule: '(-p \S+:=)'")  # rcl gives no reason
_SPIN_PERIOD = 0.1  # s within which a signal ends the node
_LAST_SPINS = 0.3  # s for which `spin_out` sends
_EXPECTED = (
    SetupError,
    ResourceError,
    ParameterException,
    NameValidationException,
    RuntimeError,
    ValueError,
)
"""Errors for the user; rcl's are RuntimeErrors, and rclpy raises ValueError for a parameter []."""


def run_node(
    make: Callable[[], Node], parameters: Sequence[Parameter], args: Sequence[str] | None = None
) -> None:
    """Run a node until Ctrl-C or SIGTERM, then end with exit code 0.

    The node may have a method `stop`, which is called while it can still publish. Unusable
    parameters and files end the process with one line and exit code 1, unknown arguments with exit
    code 2. ``--help`` prints the documentation of the node and its `parameters`.
    """
    arguments = list(sys.argv if args is None else args)
    lines = [
        f"  {p.name:24}{p.description} (default: {p.default!r}{', live' if p.live else ''})"
        for p in parameters
    ]
    parser = ArgumentParser(
        usage="%(prog)s [-h] [--ros-args -p PARAMETER:=VALUE ... -r NAME:=OTHER ...]",
        description=inspect.getdoc(make),
        epilog="\n".join(["parameters (live: can change while the node runs):", *lines]),
        formatter_class=RawDescriptionHelpFormatter,
    )
    stopped: list[int] = []
    # not restored: a second one must not interrupt `stop`
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stopped.append(received))
    try:
        parser.parse_args(remove_ros_args(arguments)[1:])
        stay_on_this_machine(os.environ)
        # rclpy's own handlers would invalidate the context before the robot has been stopped.
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = make()
    except _EXPECTED as error:
        rclpy.try_shutdown()
        # those of rcl have several lines
        reason = one_line(error)
        if empty := _EMPTY_PARAMETER.search(reason):
            reason = f"{empty[1]}: expected a value, got none; an empty text is {empty[1]}\"''\""
        sys.exit(f"{Path(sys.argv[0]).name}: {reason}")
    # Libraries and models live as long as the process: scanning them for garbage would take up to
    # 50 ms.
    gc.collect()
    gc.freeze()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stopped:
            executor.spin_once(timeout_sec=_SPIN_PERIOD)
    finally:
        if hasattr(node, "stop"):
            node.stop()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay signals until the end of the block.

    Inside rclpy, KeyboardInterrupt would become RuntimeError.
    """
    # only the main thread receives signals
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    previous = {
        each: signal.signal(each, lambda number, _: received.append(number)) for each in numbers
    }
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


async def pause(node: Node) -> None:
    """Let a node process other messages in the middle of a long callback."""
    executor: Any = node.executor
    over = Future()
    executor.create_task(over.set_result, None)
    await over


def spin_out(node: Node) -> None:
    """Spin a node for a moment before it ends, so that its last messages are sent."""
    executor: Any = node.executor
    end = time.monotonic() + _LAST_SPINS
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.01)
