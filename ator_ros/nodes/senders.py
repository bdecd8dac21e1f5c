"""Who publishes on our topics what they should not: another type of message, or a state of their own."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ator_ros.printable import printable

_MOST_TOLD = 4


def strange_senders(node: Node, topics: Mapping[str, type]) -> str:
    """Return who publishes something else than `node` listens to; empty where nobody does.

    ROS delivers none of that, and says nothing.

    Parameters
    ----------
    node : Node
        Who listens.
    topics : mapping
        Types of the messages by the topics' names.
    """
    return "; ".join(
        f"{topic}: expected {name}, {_told(sender)} publishes {printable(sender.topic_type)}"
        for topic, kind in topics.items()
        for name in [_name_of(kind)]
        for sender in node.get_publishers_info_by_topic(topic)
        if sender.topic_type != name
    )


def rival_senders(node: Node, topics: Collection[str]) -> str:
    """Return on which of the `topics` of a state there is more than one publisher, and who they are.

    Each tells of its own world, as two simulations on one domain do. One that was killed counts until DDS has
    given it up, which takes 20 s.
    """
    senders = {topic: [_told(s) for s in node.get_publishers_info_by_topic(topic)] for topic in topics}
    return "; ".join(
        f"{topic}: expected one publisher, got {len(names)}: {', '.join(sorted(names[:_MOST_TOLD]))}"
        for topic, names in senders.items()
        if len(names) > 1
    )


def _told(sender: TopicEndpointInfo) -> str:
    """Return the name of a node that publishes."""
    return f"{printable(sender.node_namespace.rstrip('/'))}/{printable(sender.node_name)}"


def _name_of(kind: type) -> str:
    """Return the name of a type of message, as in nav_msgs/msg/Odometry."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"
