"""Records topics as `ros2 bag record -s mcap` does: raw messages, with the definitions of their types."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from bags import own_types
from rclpy.qos import QoSProfile
from ros_client import Client

from ator_ros.nodes.diagnostics import type_name

DEPTH = 5000
"""Queue depth for a busy machine: as fast as possible, nodes publish hundreds of messages per second."""


class Recorder:
    """Stores all messages of topics, in publishing order.

    `topics` contains the message type and QoS profile by topic name, which begins with a slash.
    """

    def __init__(self, client: Client, topics: dict[str, tuple[Any, Any]]) -> None:
        self._types = {topic: type_name(kind) for topic, (kind, _) in topics.items()}
        self._messages: list[tuple[str, int, bytes]] = []
        for topic, (kind, offered) in topics.items():
            qos = QoSProfile(depth=DEPTH, reliability=offered.reliability, durability=offered.durability)
            client.node.create_subscription(kind, topic, self._keeper(topic), qos, raw=True)

    def _keeper(self, topic: str) -> Callable[[bytes, dict[str, int]], None]:
        def keep(raw: bytes, info: dict[str, int]) -> None:
            self._messages.append((topic, info["source_timestamp"], bytes(raw)))

        return keep

    def write(self, folder: Path, *topics: str) -> Path:
        """Write the messages of these topics to a new folder: an MCAP file and its metadata.yaml."""
        from rosbags.rosbag2 import StoragePlugin, Writer

        store = own_types()
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            links = {
                topic: writer.add_connection(topic, self._types[topic], typestore=store) for topic in topics
            }
            for topic, stamp, raw in sorted(self._messages, key=lambda kept: kept[1]):
                if topic in links:
                    writer.write(links[topic], stamp, raw)
        return folder
