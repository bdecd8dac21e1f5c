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
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.qos import SERVICES
from ator_ros.world.messages import MOST_ITEMS

Answer = Callable[[Any], None]
"""Sends the response to one request."""

_RETRY_PERIOD = 0.2
_TRIES = 10


class DeferredService:
    """Hands over each request with its `Answer`, so that several requests can be under way at once.

    rclpy sends what a service's callback returns. Here the callback returns the request, and the method that
    would send it keeps the header instead. DDS may not know a client yet that has just joined: its response
    is then sent again a few times.

    Parameters
    ----------
    node, srv_type, srv_name
        As for ``Node.create_service``.
    start : callable
        Called with each request and its `Answer`.
    work : callable
        Called after all waiting requests were started.
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
        """Start all waiting requests; may be called within a callback."""
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
        """Send one response again; only one, since that may take 0.1 s."""
        if self._unsent:
            self._send(*self._unsent.popleft())
        if not self._unsent:
            self._retrying.cancel()
