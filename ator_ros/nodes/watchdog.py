"""A timer that looks often while there is something to watch, and seldom otherwise."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from ator_ros.execution.phases import WATCH_PERIOD
from ator_ros.nodes.diagnostics import STEADY

_IDLE_PERIOD = 1.0


class Watchdog:
    """Calls `watch` in steady time, at first seldom, as each awakening of a node costs a millisecond."""

    def __init__(self, node: Node, watch: Callable[[], None]) -> None:
        self._timer = node.create_timer(_IDLE_PERIOD, watch, clock=STEADY)

    def watch(self, *, closely: bool) -> None:
        """Look every `WATCH_PERIOD` from now on, or seldom; what is so already is not begun anew."""
        period = round(1e9 * (WATCH_PERIOD if closely else _IDLE_PERIOD))
        if period != self._timer.timer_period_ns:
            self._timer.timer_period_ns = period
            self._timer.reset()
