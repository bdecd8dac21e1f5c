"""The health of a node, published on /diagnostics."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from ator_ros.nodes.diagnosis import rival_senders, type_mismatch
from ator_ros.nodes.qos import RESULTS
from ator_ros.printable import printable

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
"""Clock of timers that are independent of simulated time."""

_PERIOD = 1.0
_LASTING = 5
"""Reports in a row after which a problem is logged."""
_LONGEST = 500
_REMEMBERED = 1000


class Ticks:
    """How long ticks take, and the longest gap between them."""

    def __init__(self) -> None:
        self._last, self._longest, self._slowest = math.nan, 0.0, 0.0
        self._newest: deque[float] = deque(maxlen=_REMEMBERED)

    def record(self, now: float) -> None:
        """Record a tick that begins at `now` s."""
        if now - self._last > self._longest:
            self._longest = now - self._last
        self._last = now

    def took(self, duration: float) -> None:
        """Record how long a tick took, in s."""
        self._slowest = max(self._slowest, duration)
        self._newest.append(duration)

    def diagnostics(self) -> dict[str, object]:
        """Return the diagnostics: the longest gap and tick are those since the last call."""
        longest, slowest, self._longest, self._slowest = self._longest, self._slowest, 0.0, 0.0
        values: dict[str, object] = {"longest time between ticks (ms)": f"{1000.0 * longest:.1f}"}
        if self._newest:
            values["longest tick (ms)"] = f"{1000.0 * slowest:.1f}"
            within = 1000.0 * np.quantile(self._newest, 0.99)
            values[f"99 % of the last {_REMEMBERED} ticks within (ms)"] = f"{within:.1f}"
        return values


@dataclass(frozen=True, slots=True)
class Health:
    """A node's health.

    `problem` is what is wrong, or empty; `error` whether that keeps the node from working. `lasting` is a
    problem that is logged once it has lasted for some seconds: inputs are also missing at the start.
    """

    problem: str = ""
    error: bool = False
    values: Mapping[str, object] = field(default_factory=dict)
    lasting: str = ""


class Diagnostics:
    """Publishes a node's health on /diagnostics once a second, in steady time.

    `topics` are the types of the topics that the node subscribes to, by name: publishers of other types are
    reported, and logged once. So are several publishers of those in `states`, which only one node may
    publish.
    """

    def __init__(
        self,
        node: Node,
        health: Callable[[], Health],
        topics: Mapping[str, type] = MappingProxyType({}),
        *,
        states: Collection[str] = (),
    ) -> None:
        self._node = node
        self._health = health
        self._topics, self._states = topics, states
        self._strange: Sequence[str] = ()
        self._lasting, self._lasts, self._logged = "", 0, ""
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", RESULTS)
        self._timer = node.create_timer(_PERIOD, self.publish, clock=STEADY)

    def publish(self) -> None:
        """Publish the health now."""
        health = self._health()
        mismatches = (type_mismatch(self._node, *topic) for topic in self._topics.items())
        strange = [text for text in (*mismatches, rival_senders(self._node, self._states)) if text]
        if new := [text for text in strange if text not in self._strange]:
            self._node.get_logger().warning("; ".join(new))
        self._strange = strange
        self._log_lasting(health.lasting)
        others = (text for text in strange if text not in health.lasting)
        problem = "; ".join(filter(None, (health.lasting, health.problem, *others)))
        level = DiagnosticStatus.OK
        if problem:
            level = DiagnosticStatus.ERROR if health.error else DiagnosticStatus.WARN
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message=printable(problem or "running", _LONGEST),
            values=[
                KeyValue(key=key, value=printable(value, _LONGEST)) for key, value in health.values.items()
            ],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _log_lasting(self, problem: str) -> None:
        """Log a problem once it has been published a few times in a row, and its end."""
        self._lasts = self._lasts + 1 if problem == self._lasting else 1
        self._lasting = problem
        if problem != self._logged and self._lasts >= (_LASTING if problem else 1):
            if problem:
                self._node.get_logger().warning(printable(problem, _LONGEST))
            self._logged = problem
