"""Messages of another type than ours on our topics: ROS delivers none of them, and says nothing."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node

from ator_ros.printable import printable


def strange_senders(node: Node, topics: Mapping[str, type]) -> str:
    """Return who publishes something else than `node` listens to; empty where nobody does.

    Parameters
    ----------
    node : Node
        Who listens.
    topics : mapping
        Types of the messages by the topics' names.
    """
    return "; ".join(
        f"{topic}: expected {name}, {printable(sender.node_namespace.rstrip('/'))}/"
        f"{printable(sender.node_name)} publishes {printable(sender.topic_type)}"
        for topic, kind in topics.items()
        for name in [_name_of(kind)]
        for sender in node.get_publishers_info_by_topic(topic)
        if sender.topic_type != name
    )


def _name_of(kind: type) -> str:
    """Return the name of a type of message, as in nav_msgs/msg/Odometry."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"
