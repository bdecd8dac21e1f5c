"""Action servers of other packages, valid and faulty; the tests control how their goals end."""

from typing import Any

from action_msgs.msg import GoalStatusArray
from action_msgs.srv import CancelGoal
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_ros.actions.remote import Expectation, Filling, RemoteCall, Success, Timeouts
from ator_ros.nodes.qos import LATCHED

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
        self,
        node: Node,
        name: str = NAME,
        *,
        kind: Any = ExecuteChain,
        accepts: bool = True,
        cancels: bool = True,
    ) -> None:
        self.goals: list[ServerGoalHandle] = []
        self.canceled: list[ServerGoalHandle] = []
        self._cancels = cancels
        self._kind = kind
        super().__init__(
            node,
            kind,
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

    def finish(
        self, state: str = "succeed", *, code: int = 1, reason: str = "", number: int = -1
    ) -> None:
        """End the latest goal, or another one: succeed, abort or canceled."""
        handle, result = self.goals[number], self._kind.Result()
        if self._kind is ExecuteChain:
            result.outcome.code, result.outcome.reason = code, reason
        getattr(handle, state)()
        super().notify_execute(handle, lambda _: result)


class SilentServer:
    """A server whose answer to a goal is lost, as after it was frozen for longer than DDS waits.

    Attributes: `goals` and `canceled` are the ids in requests; with `code` it answers the latter.
    """

    def __init__(self, node: Node, code: int = CancelGoal.Response.ERROR_NONE) -> None:
        self.goals: list[bytes] = []
        self.canceled: list[bytes] = []
        self._code = code
        parts = ExecuteChain.Impl
        name = f"{NAME}/_action"
        for kind, service, answer in (
            (parts.SendGoalService, "send_goal", self._never),
            (parts.GetResultService, "get_result", self._never),
            (CancelGoal, "cancel_goal", self._cancel),
        ):
            group = ReentrantCallbackGroup()
            node.create_service(kind, f"{name}/{service}", answer, callback_group=group)
        node.create_publisher(parts.FeedbackMessage, f"{name}/feedback", 1)
        node.create_publisher(GoalStatusArray, f"{name}/status", LATCHED)

    async def _never(self, request: Any, response: Any) -> Any:
        self.goals.append(bytes(request.goal_id.uuid))
        await Future()
        return response

    def _cancel(self, request: Any, response: Any) -> Any:
        self.canceled.append(bytes(request.goal_info.goal_id.uuid))
        response.return_code = self._code
        return response
