"""Maps from the topic that the parameter `map` names; each new map replaces the previous one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nav_msgs.msg import OccupancyGrid
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.files import FileError
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.messages import grid_from
from ator_ros.nodes.parameters import SetupError, map_topic
from ator_ros.nodes.qos import LATCHED
from ator_ros.nodes.subscriptions import WARNING_PERIOD
from ator_ros.printable import one_line, quoted
from ator_ros.world.grid_map import GridMap, describe_values
from ator_ros.world.readers import MessageError

_PERIOD = 0.5  # real s between two checks whether a node that was busy is idle


class FollowedMap:
    """The map that a node takes from the topic that `settings` name, if they name one.

    `take` is called with domain and robot on each map that differs from the previous one, as soon
    as `is_idle`: reading a map takes longer than a control tick. A map that cannot be used leaves
    the previous one in use, also if `take` raises OSError. Raises SetupError if `settings` name
    neither a file nor a topic.
    """

    def __init__(
        self,
        node: Node,
        settings: Mapping[str, Any],
        domain: Domain,
        robot: Robot,
        take: Callable[[Domain, Robot], None],
        is_idle: Callable[[], bool] = lambda: True,
    ) -> None:
        self._node = node
        self._domain = domain
        self._robot = robot
        self._take = take
        self._is_idle = is_idle
        self._topic = map_topic(settings)
        self._frame = settings.get("frame")  # None: any
        self._pending: OccupancyGrid | None = None
        self._current: GridMap | None = None
        self.problem = ""
        """Why the newest map cannot be used, or that there is none yet; empty if it is in use."""
        self.is_missing = bool(self._topic)
        """Whether no map is in use, although `settings` name a topic."""
        if not self._topic:
            return
        expected = "expected a map, got none yet; start map_server, or set the parameter map"
        self.problem = f"{one_line(self._topic)}: {expected}"
        try:
            node.create_subscription(OccupancyGrid, self._topic, self._on_map, LATCHED)
        except NameValidationException as error:
            expected = "expected a file (.yaml) or the name of a topic"
            raise SetupError(f"parameter map: {expected}, got {quoted(self._topic)}") from error
        node.create_timer(_PERIOD, self._use_pending, clock=STEADY)

    def expect_usable(self) -> None:
        """Raise MessageError if no map is in use, although the node was asked to use one."""
        if self.is_missing:
            raise MessageError(self.problem)

    def _on_map(self, message: OccupancyGrid) -> None:
        self._pending = message
        self._use_pending()

    def _use_pending(self) -> None:
        if self._pending is None or not self._is_idle():
            return
        message = self._pending
        self._pending = None
        frame = message.header.frame_id if self._frame is None else self._frame
        try:
            grid = grid_from(message, self._topic, frame=frame)
            if grid == self._current:
                self.problem = ""
                return
            mapped = self._domain.on_map(grid)
            self._take(mapped, mapped.equip(self._robot))
        except (MessageError, FileError, OSError) as error:
            found = f"; {describe_values(message.data)}" if isinstance(error, FileError) else ""
            kept = "" if self.is_missing else "; the previous map is used"
            self.problem = f"{error}{found}{kept}"
            self._node.get_logger().warning(
                one_line(f"ignored: {self.problem}"), throttle_duration_sec=WARNING_PERIOD
            )
            return
        self._current = grid
        self.problem = ""
        self.is_missing = False
        self._node.get_logger().info(one_line(f"on the map {grid}"))
