"""Leases of goals: the executor ends a goal of execute_chain whose client is gone.

A client publishes a topic with the quality of service `LEASE` and names it in its goals. DDS reports
the end of the publisher: immediately if the client ends, and within 2 s if its process was
killed. The graph of ROS lists killed nodes for up to 20 s.
"""

from __future__ import annotations

import time
import uuid
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from std_msgs.msg import Empty

from ator_ros.nodes.diagnostics import type_name
from ator_ros.nodes.qos import LEASE
from ator_ros.printable import printable, quoted
from ator_ros.world.messages import MessageError

_DISCOVERY_TIMEOUT = 3.0  # real s until a publisher that the graph does not list counts as gone


def publish_lease(node: Node) -> str:
    """Publish a topic while a node exists; return its name for the field `lease` of its goals."""
    topic = f"{node.get_fully_qualified_name()}/lease_{uuid.uuid4().hex[:8]}"
    node.create_publisher(Empty, topic, LEASE)
    return topic


class Lease:
    """Watches a topic of `publish_lease`."""

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._topic = topic
        self._since = time.monotonic()
        self._is_alive: bool | None = None  # None: not reported yet
        self.users = 0
        """Number of goals with this topic."""
        callbacks = SubscriptionEventCallbacks(
            liveliness=self._take_liveliness, use_default_callbacks=False
        )
        self._subscription = node.create_subscription(
            Empty, topic, lambda _: None, LEASE, event_callbacks=callbacks
        )

    def _take_liveliness(self, event: Any) -> None:
        self._is_alive = event.alive_count > 0

    @property
    def has_ended(self) -> bool:
        """Whether the client is gone."""
        if self._is_alive is not None:
            return not self._is_alive
        is_discovered = time.monotonic() > self._since + _DISCOVERY_TIMEOUT
        return is_discovered and not self._node.count_publishers(self._topic)

    def close(self) -> None:
        """Stop watching."""
        self._node.destroy_subscription(self._subscription)


class Leases:
    """The leases of a node's goals.

    Goals share the subscription of a topic: Fast DDS reports changes only, so that a second
    subscription would not learn that the client runs.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._watched: dict[str, Lease] = {}

    def watch(self, topic: str) -> None:
        """Watch the lease of one more goal; an empty topic is none.

        Raises MessageError if the topic has no valid name, or another type than Empty.
        """
        if not topic:
            return
        if topic not in self._watched:
            self._watched[topic] = self._lease(topic)
        self._watched[topic].users += 1

    def _lease(self, topic: str) -> Lease:
        expected = (
            f"lease: expected the name of a topic of type std_msgs/Empty, got {quoted(topic)}"
        )
        try:
            name = self._node.resolve_topic_name(topic)
            types = dict(self._node.get_topic_names_and_types()).get(name, [])
            if types and type_name(Empty) not in types:
                raise MessageError(f"{expected} of type {printable(types[0])}")
            return Lease(self._node, topic)
        # RuntimeError: this node has the topic with another type; rclpy does not export RCLError
        except (InvalidTopicNameException, RuntimeError) as error:
            raise MessageError(expected) from error

    def has_ended(self, topic: str) -> bool:
        """Return whether the client of a watched lease is gone; an empty topic never ends."""
        return bool(topic) and self._watched[topic].has_ended

    def release(self, topic: str) -> None:
        """Stop watching the lease of a goal that has ended."""
        if not topic:
            return
        lease = self._watched[topic]
        lease.users -= 1
        if not lease.users:
            self._watched.pop(topic).close()
