"""A node that wakes up cheaply."""

from __future__ import annotations

from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node


class FrugalNode(Node):
    """A node whose publishers and subscriptions come without the events that rclpy adds by default.

    These are two for each, which log a mismatch of QoS and of type. rclpy collects all of them anew each time
    that the node wakes up: in the executor they were half of that work. A mismatch of QoS with somebody
    else's node is logged there; where a node has `Diagnostics` of its inputs, these name who publishes
    another type.
    """

    def create_publisher(self, *args: Any, **options: Any) -> Any:
        """Create a publisher without default events."""
        options.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*args, **options)

    def create_subscription(self, *args: Any, **options: Any) -> Any:
        """Create a subscription without default events."""
        options.setdefault("event_callbacks", SubscriptionEventCallbacks(use_default_callbacks=False))
        return super().create_subscription(*args, **options)
