"""What all nodes share: the main loop, parameters, QoS profiles, diagnostics."""

from __future__ import annotations

import hashlib
import json
import math
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

SENSOR_DATA = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For odom and ball, and for listening to commands: only the newest counts, a lost one is not sent again."""

COMMANDS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""For sending commands: reaches every listener, whatever it asks for."""

RESULTS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""For results that must all arrive."""

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""For what a late listener shall still get: the last record, the robot's description."""

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
"""For timers that run whatever the simulated time does."""

_WAKE_UP = 0.1
_DIAGNOSTICS_PERIOD = 1.0


class SetupError(Exception):
    """A node that cannot start with these parameters or files; the message is for the user."""


def run_node(make: Callable[[], Node], args: Sequence[str] | None = None) -> None:
    """Make a node and spin it until Ctrl-C or SIGTERM, then end with exit code 0.

    The node may have a method `stop`, called while it can still publish. Parameters and files that
    do not suit end the process with one line and exit code 1.
    """
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stopped.append(received))
    try:
        # rclpy's own handlers would invalidate the context before the robot has been stopped.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = make()
    except (SetupError, ParameterException, RuntimeError) as error:  # rcl's errors are RuntimeErrors
        rclpy.try_shutdown()
        sys.exit(f"{Path(sys.argv[0]).name}: {error}")
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


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a node, fixed at the start.

    Attributes
    ----------
    name : str
        Its name; a unit that is not SI is part of it.
    default : bool, int, float or str
        Default value, which also gives the type.
    description : str
        A sentence with the unit.
    low, high : float, optional
        Bounds of a number.
    choices : tuple of str, optional
        Allowed texts.
    """

    name: str
    default: Any
    description: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()

    def descriptor(self) -> ParameterDescriptor:
        """Give the description that `ros2 param describe` shows."""
        descriptor = ParameterDescriptor(description=self.description, read_only=True)
        if self.choices:
            descriptor.additional_constraints = f"one of {', '.join(self.choices)}"
        if isinstance(self.default, bool | str) or not math.isfinite(self.high - self.low):
            return descriptor
        if isinstance(self.default, int):
            bounds = IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)
            descriptor.integer_range = [bounds]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=self.low, to_value=self.high)]
        return descriptor

    def check(self, value: Any) -> None:
        """Make sure that `value` is allowed.

        Raises
        ------
        SetupError
            It is not finite, out of bounds, or none of the choices.
        """
        expected = None
        if self.choices and value not in self.choices:
            expected = f"one of {', '.join(self.choices)}"
        if isinstance(value, int | float) and not (math.isfinite(value) and self.low <= value <= self.high):
            expected = f"a finite number from {self.low:g} to {self.high:g}"
        if expected:
            raise SetupError(f"parameter {self.name}: expected {expected}, got {value!r}")


def declare_parameters(node: Node, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Declare parameters with type, description and bounds; give their values by name.

    Raises
    ------
    SetupError
        A value has another type, or is not allowed.
    """
    values = {}
    for parameter in parameters:
        try:
            node.declare_parameter(parameter.name, parameter.default, parameter.descriptor())
        except ParameterException as error:
            raise SetupError(f"parameter {parameter.name} ({parameter.description}): {error}") from error
        values[parameter.name] = node.get_parameter(parameter.name).value
        parameter.check(values[parameter.name])
    return values


def digest_of(settings: Mapping[str, Any]) -> str:
    """Give a short digest of parameters and their values."""
    text = json.dumps(dict(settings), sort_keys=True, default=list)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class Lateness:
    """How late things come that should come regularly: the longest wait since it was last asked for."""

    def __init__(self) -> None:
        self._last, self._longest = math.nan, 0.0

    def came(self, now: float) -> None:
        """Note that one came at `now` s."""
        if now - self._last > self._longest:
            self._longest = now - self._last
        self._last = now

    def take(self) -> str:
        """Give the longest time between two in ms, as text, and begin anew."""
        longest, self._longest = self._longest, 0.0
        return f"{1000.0 * longest:.1f}"


@dataclass(frozen=True, slots=True)
class Health:
    """How a node is: what is wrong (empty: nothing), whether it cannot work so, and values by name."""

    problem: str = ""
    error: bool = False
    values: Mapping[str, object] = field(default_factory=dict)


class Diagnostics:
    """Publishes a node's health on /diagnostics once a second, in steady time.

    Parameters
    ----------
    node : Node
        Whose health.
    health : callable
        Gives the present `Health`.
    """

    def __init__(self, node: Node, health: Callable[[], Health]) -> None:
        self._node = node
        self._health = health
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", RESULTS)
        self._timer = node.create_timer(_DIAGNOSTICS_PERIOD, self.publish, clock=STEADY)

    def publish(self) -> None:
        """Publish the health now."""
        health = self._health()
        level = DiagnosticStatus.OK
        if health.problem:
            level = DiagnosticStatus.ERROR if health.error else DiagnosticStatus.WARN
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message=health.problem or "running",
            values=[KeyValue(key=key, value=str(value)) for key, value in health.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
