"""Requests that are answered later, without ROS between."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.service import Service

from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes.deferred_service import DeferredService


class FakeNode:
    """Keeps the timer's callback, and hands over requests as rclpy's executor does."""

    def __init__(self) -> None:
        self.running = True
        self.service: Any = None
        self.queue: list[tuple[Any, Any]] = []
        self.logger = logging.getLogger("fake")

    def create_service(self, _: Any, __: str, callback: Any, **___: Any) -> Any:
        self.service = SimpleNamespace(callback=callback, handle=self)
        return self.service

    def create_timer(self, _: float, callback: Any, **__: Any) -> Any:
        self.retry = callback
        return SimpleNamespace(cancel=lambda: self.switch(on=False), reset=lambda: self.switch(on=True))

    def service_take_request(self, _: Any) -> tuple[Any, Any]:
        return self.queue.pop(0) if self.queue else (None, None)

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def switch(self, *, on: bool) -> None:
        self.running = on

    def get_logger(self) -> logging.Logger:
        return self.logger

    def ask(self, request: Any, header: str) -> None:
        self.service.send_response(self.service.callback(request, RefineSubgoal.Response()), header)


def served(
    monkeypatch: pytest.MonkeyPatch, failures: list[Exception]
) -> tuple[FakeNode, list[Any], list[Any]]:
    """Return a node, what its service has begun, and what was sent once `failures` have been raised."""
    node, begun, sent = FakeNode(), [], []

    def send(_: Any, response: Any, header: Any) -> None:
        if failures:
            raise failures.pop()
        sent.append((header, response))

    monkeypatch.setattr(Service, "send_response", send)
    made: Any = node
    DeferredService(
        made,
        RefineSubgoal,
        "service",
        lambda request, answer: begun.append((request, answer)),
        work=lambda: begun.append("work"),
    )
    return node, begun, sent


def test_requests_are_answered_in_whatever_order(monkeypatch: pytest.MonkeyPatch) -> None:
    node, begun, sent = served(monkeypatch, [])
    node.queue = [("second", "header 2")]
    node.ask("first", "header 1")
    assert sent == []
    assert begun.pop() == "work"
    assert [request for request, _ in begun] == ["first", "second"]
    begun[1][1]("answer 2")
    begun[0][1]("answer 1")
    assert sent == [("header 2", "answer 2"), ("header 1", "answer 1")]


def test_a_client_that_is_not_discovered_yet_is_answered_later(monkeypatch: pytest.MonkeyPatch) -> None:
    node, begun, sent = served(monkeypatch, [RuntimeWarning("timeout"), RuntimeWarning("timeout")])
    node.ask("request", "header")
    begun[0][1]("answer")
    assert (sent, node.running) == ([], True)
    node.retry()
    assert (sent, node.running) == ([], True)
    node.retry()
    assert (sent, node.running) == ([("header", "answer")], False)


@pytest.mark.parametrize("error", [RuntimeWarning("timeout"), RuntimeError("gone")])
def test_a_client_that_is_gone_is_given_up(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    node, begun, sent = served(monkeypatch, [error] * 100)
    node.ask("request", "header")
    begun[0][1]("answer")
    for _ in range(20):
        if node.running:
            node.retry()
    assert (sent, node.running) == ([], False)
