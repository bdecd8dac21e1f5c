"""Maps from the topic that the parameter `map` names; each new map replaces the previous one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from nav_msgs.msg import OccupancyGrid
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

from ator_ros.domains.domain import Domain
from ator_ros.files import FileError
from ator_ros.nodes.diagnostics import STEADY, WARNING_PERIOD
from ator_ros.nodes.messages import grid_from
from ator_ros.nodes.parameters import SetupError, map_topic
from ator_ros.nodes.qos import LATCHED
from ator_ros.printable import one_line, quoted
from ator_ros.robot.description import Robot
from ator_ros.world.grid_map import GridMap, values_of
from ator_ros.world.messages import MessageError

_PERIOD = 0.5  # real s between two checks whether a node that was busy is idle


@dataclass
class FollowedMap:
    """The map that a node takes from a topic; of a node without such a topic it has no fault."""

    problem: str = ""
    """Why the newest map cannot be used, or that there is none yet; empty if it is in use."""
    is_missing: bool = False
    """Whether no map of the topic is in use."""

    def expect_usable(self) -> None:
        """Raise MessageError if no map is in use, although the node was asked to use one."""
        if self.is_missing:
            raise MessageError(self.problem)


def follow_map(
    node: Node,
    settings: Mapping[str, Any],
    domain: Domain,
    robot: Robot,
    take: Callable[[Domain, Robot], None],
    is_idle: Callable[[], bool] = lambda: True,
) -> FollowedMap:
    """Subscribe to the topic of the map, if `settings` name one; return the state of its map.

    `take` is called with domain and robot on each map that differs from the previous one, as soon
    as `is_idle`: reading a map takes longer than a control tick. A map that cannot be used leaves
    the previous one in use, also if `take` raises OSError. Raises SetupError if `settings` name
    neither a file nor a topic.
    """
    topic = map_topic(settings)
    followed = FollowedMap()
    if not topic:
        return followed
    followed.is_missing = True
    shown = one_line(topic)
    followed.problem = (
        f"{shown}: expected a map, got none yet; start map_server, or set the parameter map"
    )
    pending: OccupancyGrid | None = None
    current: GridMap | None = None

    def on_map(message: OccupancyGrid) -> None:
        nonlocal pending
        pending = message
        use_pending()

    def use_pending() -> None:
        nonlocal pending, current
        if pending is None or not is_idle():
            return
        message, pending = pending, None
        try:
            grid = grid_from(message, topic, frame=settings.get("frame", message.header.frame_id))
            if grid == current:
                followed.problem = ""
                return
            mapped = domain.on_map(grid)
            take(mapped, mapped.equip(robot))
        except (MessageError, FileError, OSError) as error:
            found = f"; {values_of(message.data)}" if isinstance(error, FileError) else ""
            kept = "" if followed.is_missing else "; the previous map is used"
            followed.problem = f"{error}{found}{kept}"
            node.get_logger().warning(
                f"ignored: {followed.problem}", throttle_duration_sec=WARNING_PERIOD
            )
            return
        current = grid
        followed.problem, followed.is_missing = "", False
        node.get_logger().info(one_line(f"on the map {grid}"))

    try:
        node.create_subscription(OccupancyGrid, topic, on_map, LATCHED)
    except NameValidationException as error:
        expected = "expected a file (.yaml) or the name of a topic"
        raise SetupError(f"parameter map: {expected}, got {quoted(topic)}") from error
    node.create_timer(_PERIOD, use_pending, clock=STEADY)
    return followed
