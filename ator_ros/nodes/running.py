"""The main loop of all nodes, and their command line."""

from __future__ import annotations

import gc
import inspect
import itertools
import os
import re
import signal
import sys
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ator_ros.files import FileError, read_yaml
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.nodes.parameters import Parameter, SetupError
from ator_ros.printable import printable, short
from ator_ros.resources import ResourceError

_WAKE_UP = 0.1
_LAST_SPINS = 0.3  # s
_LIST = re.compile(r"Parameters: see `\w+`")
"""Where a node's docstring names the list in its source; the help prints that list itself."""
_RCL_SOURCE = re.compile(r", at \S+:\d+")
"""Where rcl's errors, which have several lines, name their place in its source."""
_LONGEST_REASON = 1000
"""Characters of the line with which a node ends: a path may have 255 in each of its parts."""
_LARGEST = 1_000_000  # bytes of a parameter file; ours have some 2 kB, and PyYAML takes seconds for 1 MB
_SETTINGS = "ros__parameters"


_EXPECTED = (SetupError, ResourceError, ParameterException, RuntimeError)
"""Errors for the user; rcl's are RuntimeErrors."""


def run_node(
    make: Callable[[], Node], parameters: Sequence[Parameter] = (), args: Sequence[str] | None = None
) -> None:
    """Make a node and spin it until Ctrl-C or SIGTERM, then end with exit code 0.

    The node may have a method `stop`, which is called while it can still publish. Unusable parameters and
    files end the process with one line and exit code 1, unknown arguments with exit code 2. ``--help`` prints
    the documentation of the node and its `parameters`.
    """
    arguments = list(sys.argv if args is None else args)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):  # for good: a second one must not disturb the end
        signal.signal(number, lambda received, _: stopped.append(received))
    try:
        check_parameters(arguments, {parameter.name: parameter.description for parameter in parameters})
        _command_line(make, parameters).parse_args(remove_ros_args(arguments)[1:])
        stay_on_this_machine(os.environ)
        # rclpy's own handlers would invalidate the context before the robot has been stopped.
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = make()
    except _EXPECTED as error:
        rclpy.try_shutdown()
        reason = printable(_RCL_SOURCE.sub("", " ".join(str(error).split())), _LONGEST_REASON)
        sys.exit(f"{Path(sys.argv[0]).name}: {reason}")
    # Libraries and models live as long as the process: scanning them for garbage would take up to 50 ms.
    gc.collect()
    gc.freeze()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stopped:
            executor.spin_once(timeout_sec=_WAKE_UP)
    finally:
        if hasattr(node, "stop"):
            node.stop()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def spin_out(node: Node) -> None:
    """Spin a node for a moment before it ends, so that its last messages are sent."""
    executor: Any = node.executor
    end = time.monotonic() + _LAST_SPINS
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.01)


def _command_line(make: Callable[[], Node], parameters: Sequence[Parameter]) -> ArgumentParser:
    """Return the command line of a node, which takes ROS's own arguments only."""
    lines = [f"  {p.name:24}{p.description} (default: {p.default!r})" for p in parameters]
    return ArgumentParser(
        usage="%(prog)s [-h] [--ros-args -p PARAMETER:=VALUE ... -r NAME:=OTHER ...]",
        description=_LIST.sub("Parameters: below", inspect.getdoc(make) or ""),
        epilog="\n".join(["parameters:", *lines]) if lines else None,
        formatter_class=RawDescriptionHelpFormatter,
    )


def check_parameters(arguments: Sequence[str], descriptions: Mapping[str, str]) -> None:
    """Check what rclpy and rcl do not report clearly; call this before they read the command line.

    rcl waits for ever for a pipe as a parameter file, and ignores a text that holds no parameters. rclpy
    raises a ValueError without the parameter's name for an empty list, whose type is unknown.

    Parameters
    ----------
    arguments : sequence of str
        The command line.
    descriptions : mapping of str to str
        Descriptions of the node's parameters by name.

    Raises
    ------
    SetupError
        A parameter is an empty list; a file cannot be read, or holds something else than parameters.
    """
    for argument, following in itertools.pairwise(arguments):
        if argument in ("-p", "--param"):
            name, _, value = following.partition(":=")
            _refuse_empty({name: [] if value.replace(" ", "") == "[]" else value}, descriptions)
        if argument != "--params-file":
            continue
        try:
            content = read_yaml(Path(following), largest=_LARGEST)
        except FileError as error:
            raise SetupError(f"--params-file: {error}") from error
        if content is not None and not _holds_parameters(content):
            raise SetupError(
                f"--params-file: {following}: expected a table of nodes, each with {_SETTINGS}, "
                f"got {short(content)}"
            )
        _refuse_empty(content or {}, descriptions)


def _refuse_empty(content: Mapping[Any, Any], descriptions: Mapping[str, str]) -> None:
    """Raise SetupError for the first empty list in nested tables."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            _refuse_empty(value, descriptions)
        elif value == []:
            description = descriptions.get(name, "")
            raise SetupError(
                f"parameter {name}{f' ({description})' if description else ''}: "
                "expected a value, or a list of one or more, got []"
            )


def _holds_parameters(content: Any) -> bool:
    """Return whether each branch of nested tables, which are namespaces and nodes, leads to parameters."""
    if not isinstance(content, Mapping) or not content:
        return False
    return _SETTINGS in content or all(map(_holds_parameters, content.values()))
