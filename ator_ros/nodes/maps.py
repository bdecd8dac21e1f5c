"""Maps from a topic: the parameter `map` names it, and each new map replaces the former one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nav_msgs.msg import OccupancyGrid
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

from ator_ros.files import FileError
from ator_ros.nodes.diagnostics import STEADY, WARNING_PERIOD
from ator_ros.nodes.messages import grid_from
from ator_ros.nodes.parameters import SetupError, map_topic
from ator_ros.nodes.qos import LATCHED
from ator_ros.printable import quoted
from ator_ros.world.grid_map import GridMap
from ator_ros.world.messages import MessageError

_PERIOD = 0.5  # real s between two checks whether a node that was busy is idle


def follow_map(
    node: Node,
    settings: Mapping[str, Any],
    take: Callable[[GridMap], None],
    is_idle: Callable[[], bool] = lambda: True,
) -> None:
    """Subscribe to the topic of the map, if `settings` name one.

    `take` is called with each map that differs from the former one, as soon as `is_idle`: reading a map takes
    longer than a control tick. If it raises FileError or OSError, the former map stays in use. Raises
    SetupError if `settings` name neither a file nor a topic.
    """
    topic = map_topic(settings)
    if not topic:
        return
    newest: OccupancyGrid | None = None
    used: GridMap | None = None

    def received(message: OccupancyGrid) -> None:
        nonlocal newest
        newest = message
        use()

    def use() -> None:
        nonlocal newest, used
        if newest is None or not is_idle():
            return
        message, newest = newest, None
        try:
            grid = grid_from(message, topic, frame=settings.get("frame", message.header.frame_id))
            if grid == used:
                return
            take(grid)
        except (MessageError, FileError, OSError) as error:
            node.get_logger().warning(f"ignored: {error}", throttle_duration_sec=WARNING_PERIOD)
            return
        used = grid
        node.get_logger().info(f"on the map {grid}")

    try:
        node.create_subscription(OccupancyGrid, topic, received, LATCHED)
    except NameValidationException as error:
        raise SetupError(
            f"parameter map: expected a file (.yaml) or the name of a topic, got {quoted(topic)}"
        ) from error
    node.create_timer(_PERIOD, use, clock=STEADY)
