"""Records topics as `ros2 bag record -s mcap` does: raw messages, with the definitions of their types."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from bag_types import own_types
from ros_client import Client


class Recorder:
    """Keeps the messages of topics as they come.

    Parameters
    ----------
    client : Client
        Hears the topics.
    topics : dict
        Message type and QoS profile by topic name, which begins with a slash.
    """

    def __init__(self, client: Client, topics: dict[str, tuple[Any, Any]]) -> None:
        self._types = {topic: type_name(kind) for topic, (kind, _) in topics.items()}
        self._messages: list[tuple[str, int, bytes]] = []
        for topic, (kind, qos) in topics.items():
            client.node.create_subscription(
                kind, topic, lambda raw, topic=topic: self._keep(topic, raw), qos, raw=True
            )

    def _keep(self, topic: str, raw: bytes) -> None:
        self._messages.append((topic, time.time_ns(), bytes(raw)))

    def write(self, folder: Path, *topics: str) -> Path:
        """Write what was heard on these topics to a new folder: an MCAP file and its metadata.yaml."""
        from rosbags.rosbag2 import StoragePlugin, Writer

        store = own_types()
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            links = {
                topic: writer.add_connection(topic, self._types[topic], typestore=store) for topic in topics
            }
            for topic, stamp, raw in self._messages:
                if topic in links:
                    writer.write(links[topic], stamp, raw)
        return folder


def type_name(kind: Any) -> str:
    """Return the name of a message class as ROS writes it, like geometry_msgs/msg/Twist."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"
