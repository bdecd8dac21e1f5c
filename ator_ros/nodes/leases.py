"""Leases of goals: the executor ends a goal of execute_chain whose client is gone.

A client publishes a topic with the quality of service `LEASE` and names it in its goals. DDS
reports the end of the publisher: immediately if the client ends, and within 2 s if its process was
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
from ator_ros.world.readers import MessageError

_LONGEST_NAME = 255  # characters of a topic of DDS; ROS would check a longer one for 0.1 s
_DISCOVERY_TIMEOUT = 3.0  # real s until a publisher that the graph does not list counts as gone


def publish_lease(node: Node) -> str:
    """Publish a topic while a node exists; return its name for the field `lease` of its goals."""
    topic = f"{node.get_fully_qualified_name()}/lease_{uuid.uuid4().hex[:8]}"
    node.create_publisher(Empty, topic, LEASE)
    return topic


class LeaseWatch:
    """Watches the lease of a node's newest goal.

    A goal with the same lease shares its subscription: Fast DDS reports changes only, so that
    a second subscription would not learn that the client runs.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._topic = ""
        self._subscription: Any = None
        self._since = 0.0  # monotonic s
        self._is_alive: bool | None = None  # None: not reported yet

    def watch(self, topic: str) -> None:
        """Watch the lease of a goal, in place of the one before; an empty topic is none.

        Raises MessageError if the topic has no valid name, or another type than Empty; the lease
        before is then still watched.
        """
        if topic == self._topic and not self.has_ended:
            return
        subscription = self._subscribed(topic) if topic else None
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        self._topic = topic
        self._subscription = subscription
        self._since = time.monotonic()
        self._is_alive = None

    def _subscribed(self, topic: str) -> Any:
        expected = (
            f"lease: expected the name of a topic of type std_msgs/Empty, got {quoted(topic)}"
        )
        if len(topic) > _LONGEST_NAME:
            raise MessageError(expected)

        def take_liveliness(event: Any) -> None:
            if topic == self._topic:
                self._is_alive = event.alive_count > 0

        callbacks = SubscriptionEventCallbacks(
            liveliness=take_liveliness, use_default_callbacks=False
        )
        try:
            name = self._node.resolve_topic_name(topic)
            types = dict(self._node.get_topic_names_and_types()).get(name, [])
            if types and type_name(Empty) not in types:
                raise MessageError(f"{expected} of type {printable(types[0])}")
            return self._node.create_subscription(
                Empty, topic, lambda _: None, LEASE, event_callbacks=callbacks
            )
        # RuntimeError: this node has the topic with another type; rclpy does not export RCLError
        except (InvalidTopicNameException, RuntimeError) as error:
            raise MessageError(expected) from error

    @property
    def has_ended(self) -> bool:
        """Whether the client is gone; one without a lease never is."""
        if not self._topic:
            return False
        if self._is_alive is not None:
            return not self._is_alive
        is_discovered = time.monotonic() > self._since + _DISCOVERY_TIMEOUT
        return is_discovered and not self._node.count_publishers(self._topic)
