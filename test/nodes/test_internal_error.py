"""An exception that nobody expected, while a request is refined: told, and answered."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy")

from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes.refinement import RefinementNode
from ator_ros.refinement.search import Deadline


class Broken(RefinementNode):
    """A node that was never started, and whose every request fails."""

    def __init__(self) -> None:
        self._refused, self._last_refusal, self._settings = 0, "", {"deadline": 1.0}
        self.said: list[str] = []

    def get_logger(self) -> Any:
        return self

    def error(self, text: str, **options: Any) -> None:
        self.said.append(text)

    def _refine(self, request: RefineSubgoal.Request, deadline: Deadline) -> RefineSubgoal.Response:
        raise ZeroDivisionError("a fault of ours")


def test_a_fault_in_one_request_is_answered_and_logged() -> None:
    node = Broken()
    response = node._serve(RefineSubgoal.Request(), RefineSubgoal.Response())
    assert not response.accepted
    assert response.reason == "internal error: ZeroDivisionError('a fault of ours')"
    assert len(node.said) == 1
    assert "Traceback" in node.said[0]
