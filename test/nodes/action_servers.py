"""Action servers as others write them, good ones and bad ones; they execute what the tests tell them to."""

from __future__ import annotations

from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_ros.actions.remote import Expectation, Filling, RemoteCall, Success, Timeouts

NAME = "drive"


def declared(**changes: Any) -> RemoteCall:
    """Return how the servers here are declared: their goal is a chain of one step."""
    values: dict[str, Any] = {
        "server": NAME,
        "type": "ator_interfaces/action/ExecuteChain",
        "goal": (
            Filling("chain.calls[0].top", constant="goToPose"),
            Filling("chain.calls[0].goal", source="goal", frame="map"),
            Filling("chain.calls[0].speed", source="goal.speed"),
            Filling("chain.action_set", source="frame"),
            Filling("fetches", constant=3),
        ),
        "success": Success(fields=(Expectation("outcome.code", 1),), reason="outcome.reason"),
        "timeouts": Timeouts(server=0.6, acceptance=0.5, silence=0.6, result=4.0, cancel=0.5),
    }
    return RemoteCall(**values | changes)


class Server(ActionServer):
    """A server that keeps its goals until it is told how they end.

    Parameters
    ----------
    node : Node
        Whose server.
    accepts, cancels : bool
        Whether it accepts goals and cancellations.
    """

    def __init__(self, node: Node, *, accepts: bool = True, cancels: bool = True) -> None:
        self.goals: list[ServerGoalHandle] = []
        self.canceled: list[ServerGoalHandle] = []
        self._cancels = cancels
        super().__init__(
            node,
            ExecuteChain,
            NAME,
            self.goals.append,
            goal_callback=lambda _: GoalResponse.ACCEPT if accepts else GoalResponse.REJECT,
            cancel_callback=self._cancel,
        )

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        self.canceled.append(handle)
        return CancelResponse.ACCEPT if self._cancels else CancelResponse.REJECT

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Keep a goal that is to be executed."""
        (execute_callback or self._execute_callback)(goal_handle)

    def finish(self, state: str = "succeed", *, code: int = 1, reason: str = "") -> None:
        """Bring the latest goal to its end: succeed, abort or canceled."""
        handle, result = self.goals[-1], ExecuteChain.Result()
        result.outcome.code, result.outcome.reason = code, reason
        getattr(handle, state)()
        super().notify_execute(handle, lambda _: result)


class Deaf(Server):
    """A server that answers no cancellation, as one whose only thread drives."""

    deaf = True

    async def _execute_cancel_request(self, request_header_and_message: Any) -> None:
        if not self.deaf:
            await super()._execute_cancel_request(request_header_and_message)

    def tell(self) -> None:
        """Publish feedback on the latest goal."""
        self.goals[-1].publish_feedback(ExecuteChain.Feedback())


class Mute(Server):
    """A server that answers goals only when it is told to."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self.waiting: list[Any] = []

    async def _execute_goal_request(self, request: Any) -> None:
        self.waiting.append(request)

    async def answer(self) -> None:
        """Accept the latest goal."""
        await super()._execute_goal_request(self.waiting.pop())


class Echo(Server):
    """A server that answers everything twice."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._handle = _Twice(self._handle)


class _Twice:
    """The server's other half, in C, with answers sent twice."""

    def __init__(self, handle: Any) -> None:
        self._handle = handle

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._handle, name)
        if name not in ("send_goal_response", "send_result_response", "send_cancel_response"):
            return found
        return lambda *arguments: [found(*arguments) for _ in range(2)]

    def __enter__(self) -> Any:
        return self._handle.__enter__()

    def __exit__(self, *error: object) -> Any:
        return self._handle.__exit__(*error)
