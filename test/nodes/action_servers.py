"""Action servers of other packages, valid and faulty; the tests control how their goals end."""

from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_ros.actions.remote import Expectation, Filling, RemoteCall, Success, Timeouts

NAME = "drive"


def declared(**changes: Any) -> RemoteCall:
    """Return the declaration of these servers: their goal is a chain of one step."""
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
    """A server that keeps its goals until a test finishes them.

    It may reject goals or cancellations.
    """

    def __init__(
        self, node: Node, name: str = NAME, *, accepts: bool = True, cancels: bool = True
    ) -> None:
        self.goals: list[ServerGoalHandle] = []
        self.canceled: list[ServerGoalHandle] = []
        self._cancels = cancels
        super().__init__(
            node,
            ExecuteChain,
            name,
            self.goals.append,
            goal_callback=lambda _: GoalResponse.ACCEPT if accepts else GoalResponse.REJECT,
            cancel_callback=self._cancel,
        )

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        self.canceled.append(handle)
        return CancelResponse.ACCEPT if self._cancels else CancelResponse.REJECT

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Store a goal for `finish`."""
        self.goals.append(goal_handle)

    def finish(self, state: str = "succeed", *, code: int = 1, reason: str = "") -> None:
        """End the latest goal: succeed, abort or canceled."""
        handle, result = self.goals[-1], ExecuteChain.Result()
        result.outcome.code, result.outcome.reason = code, reason
        getattr(handle, state)()
        super().notify_execute(handle, lambda _: result)
