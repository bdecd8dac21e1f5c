"""Maps from a topic: the parameter `map` names it, and each new map replaces the one before."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nav_msgs.msg import OccupancyGrid
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

from ator_ros.files import FileError
from ator_ros.nodes.messages import grid_from
from ator_ros.nodes.parameters import SetupError, map_topic
from ator_ros.nodes.qos import LATCHED
from ator_ros.printable import quoted
from ator_ros.world.grid_map import GridMap
from ator_ros.world.messages import MessageError

_WARNING_PERIOD = 2.0


def follow_map(node: Node, settings: Mapping[str, Any], take: Callable[[GridMap], None]) -> None:
    """Subscribe to the topic of the map, if `settings` name one; `take` is called with each other map.

    Where it raises FileError or OSError, the former map stays in use. Raises SetupError if `settings` name
    neither a file nor a topic.
    """
    topic = map_topic(settings)
    if not topic:
        return
    known: list[GridMap] = []

    def received(message: OccupancyGrid) -> None:
        try:
            grid = grid_from(message, topic, frame=settings.get("frame", message.header.frame_id))
            if known == [grid]:
                return
            take(grid)
        except (MessageError, FileError, OSError) as error:
            node.get_logger().warning(f"ignored: {error}", throttle_duration_sec=_WARNING_PERIOD)
            return
        known[:] = [grid]
        node.get_logger().info(f"on the map {grid}")

    try:
        node.create_subscription(OccupancyGrid, topic, received, LATCHED)
    except NameValidationException as error:
        raise SetupError(
            f"parameter map: expected a file (.yaml) or the name of a topic, got {quoted(topic)}"
        ) from error
