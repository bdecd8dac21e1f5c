"""Detection of publishers of a wrong message type, and of several publishers of one state."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ator_ros.printable import printable

_MOST_TOLD = 4


def strange_senders(node: Node, topics: Mapping[str, type]) -> str:
    """Return which nodes publish another type than `node` subscribes to; empty if none does.

    ROS drops such messages silently.

    Parameters
    ----------
    node : Node
        The subscriber.
    topics : mapping
        Message types by topic name.
    """
    return "; ".join(
        f"{topic}: expected {name}, {_told(sender)} publishes {printable(sender.topic_type)}"
        for topic, kind in topics.items()
        for name in [_name_of(kind)]
        for sender in node.get_publishers_info_by_topic(topic)
        if sender.topic_type != name
    )


def rival_senders(node: Node, topics: Collection[str]) -> str:
    """Return the topics with several publishers, and the publishers' names. Each should have one source.

    Two simulations on one domain are an example. A publisher that was killed counts until DDS drops it after
    20 s.
    """
    senders = {topic: [_told(s) for s in node.get_publishers_info_by_topic(topic)] for topic in topics}
    return "; ".join(
        f"{topic}: expected one publisher, got {len(names)}: {', '.join(sorted(names[:_MOST_TOLD]))}"
        for topic, names in senders.items()
        if len(names) > 1
    )


def _told(sender: TopicEndpointInfo) -> str:
    """Return the full name of a publishing node."""
    return f"{printable(sender.node_namespace.rstrip('/'))}/{printable(sender.node_name)}"


def _name_of(kind: type) -> str:
    """Return the name of a message type, such as nav_msgs/msg/Odometry."""
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"
