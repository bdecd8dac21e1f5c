"""A service whose requests are answered later than its callback returns."""

from __future__ import annotations

import functools
import warnings
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.service import Service

from ator_ros.nodes.bounded import bounded, with_parts
from ator_ros.nodes.checks import MOST_ITEMS
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.qos import SERVICES

Answer = Callable[[Any], None]
"""Sends the response to one request."""

_RETRY_PERIOD = 0.2
_TRIES = 10


class DeferredService:
    """Hands over each request with what answers it, so that several can be under way at once.

    rclpy sends what a service's callback returns. Here the callback returns the request, and what would send
    that keeps the header instead. A client that has just joined may not be known to DDS yet: its response is
    sent again some times.

    Parameters
    ----------
    node, srv_type, srv_name
        As for ``Node.create_service``.
    start : callable
        Is given each request and its `Answer`.
    work : callable
        Is called when all that have come are started.
    """

    def __init__(
        self,
        node: Node,
        srv_type: Any,
        srv_name: str,
        start: Callable[[Any, Answer], None],
        *,
        work: Callable[[], None],
    ) -> None:
        self._node, self._request = node, bounded(srv_type.Request, MOST_ITEMS)
        self._start, self._work = start, work
        self._service: Any = node.create_service(
            srv_type, srv_name, lambda request, _: request, qos_profile=SERVICES
        )
        self._service.srv_type = with_parts(srv_type, Request=self._request)  # rclpy takes some by itself
        self._service.send_response = self._serve
        self._unsent: deque[tuple[Any, Any, int]] = deque()
        self._retrying = node.create_timer(_RETRY_PERIOD, self._retry, clock=STEADY)
        self._retrying.cancel()

    def take(self) -> None:
        """Start the requests that have come: also while rclpy's executor waits for a callback to return."""
        while True:
            with self._service.handle:
                request, header = self._service.handle.service_take_request(self._request)
            if header is None:
                return
            self._begin(request, header)

    def _serve(self, request: Any, header: Any) -> None:
        self._begin(request, header)
        self.take()
        self._work()

    def _begin(self, request: Any, header: Any) -> None:
        self._start(request, functools.partial(self._send, header))

    def _send(self, header: Any, response: Any, tries: int = _TRIES) -> None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                Service.send_response(self._service, response, header)
        except RuntimeWarning as late:  # rclpy's, where DDS has not discovered the client in 0.1 s
            if tries > 1:
                self._unsent.append((header, response, tries - 1))
                self._retrying.reset()
            else:
                self._node.get_logger().warning(f"a client that cannot be reached has no answer: {late}")
        except RuntimeError as gone:  # rcl's
            self._node.get_logger().debug(f"not answered: {gone}")

    def _retry(self) -> None:
        """Send one response again, as that may take 0.1 s."""
        if self._unsent:
            self._send(*self._unsent.popleft())
        if not self._unsent:
            self._retrying.cancel()
