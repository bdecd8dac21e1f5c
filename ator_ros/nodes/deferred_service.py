"""A service whose requests are answered later than its callback returns."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.service import Service

from ator_ros.nodes.qos import SERVICES

Answer = Callable[[Any], None]
"""Sends the response to one request."""


class DeferredService:
    """Hands over each request with what answers it, so that several can be under way at once.

    rclpy sends what a service's callback returns. Here the callback returns the request, and what would send
    that keeps the header instead.

    Parameters
    ----------
    node, srv_type, srv_name
        As for ``Node.create_service``.
    start : callable
        Is given each request and its `Answer`.
    """

    def __init__(
        self, node: Node, srv_type: Any, srv_name: str, start: Callable[[Any, Answer], None]
    ) -> None:
        self._node, self._request, self._start = node, srv_type.Request, start
        self._service: Any = node.create_service(
            srv_type, srv_name, lambda request, _: request, qos_profile=SERVICES
        )
        self._service.send_response = self._begin

    def take(self) -> None:
        """Start the requests that have come: also while rclpy's executor waits for a callback to return."""
        while True:
            with self._service.handle:
                request, header = self._service.handle.service_take_request(self._request)
            if header is None:
                return
            self._begin(request, header)

    def _begin(self, request: Any, header: Any) -> None:
        self._start(request, functools.partial(self._send, header))

    def _send(self, header: Any, response: Any) -> None:
        try:
            Service.send_response(self._service, response, header)
        except RuntimeError as error:  # rcl's error where the client is gone
            self._node.get_logger().debug(f"not answered: {error}")
