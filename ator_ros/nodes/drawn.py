"""Latched topics for drawing, whose messages are expensive to build."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node

from ator_ros.nodes.qos import LATCHED


class Drawn:
    """A latched topic whose newest message is made only once it has a subscriber, early or late.

    Parameters
    ----------
    node : Node
        Who publishes.
    kind : type
        Of the messages.
    topic : str
        Name of the topic.
    """

    def __init__(self, node: Node, kind: type[Any], topic: str) -> None:
        self._waiting: Callable[[], Any] | None = None
        heard = PublisherEventCallbacks(matched=lambda _: self._send(), use_default_callbacks=False)
        self._publisher = node.create_publisher(kind, topic, LATCHED, event_callbacks=heard)

    def offer(self, make: Callable[[], Any]) -> None:
        """Publish what `make` returns, now or once there is a subscriber; a newer offer replaces it."""
        self._waiting = make
        self._send()

    def _send(self) -> None:
        if self._waiting is not None and self._publisher.get_subscription_count():
            make, self._waiting = self._waiting, None
            self._publisher.publish(make())
