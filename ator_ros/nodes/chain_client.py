"""The client of the action execute_chain, for every program that sends chains."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome
from ator_ros.nodes.diagnostics import STEADY
from ator_ros.nodes.leases import publish_lease
from ator_ros.nodes.qos import ACTION_QUEUES, SERVICES

NO_EXECUTOR = "execute_chain: expected its action server, got none; start the executor"
_REJECTED = "execute_chain: the executor rejected the goal; see its log"
_RESTARTED = (
    "execute_chain: the executor was restarted, or a second one was started; send the goal again"
)
_PERIOD = 0.1  # real s between two looks at the graph; a goal's feedback has the same period


class SentChain:
    """A chain that was sent.

    Attributes
    ----------
    chain_id : str
        The goal's id as in the executor's records, 32 hexadecimal digits.
    result : Future
        Its ExecuteChain.Result. A chain that the executor rejected has the outcome REFUSED, one
        whose executor is missing INPUT_LOST; the record in the result is then empty.
    """

    def __init__(self) -> None:
        self.chain_id = uuid.uuid4().hex
        self.result = Future()
        self._handle: ClientGoalHandle | None = None
        self._is_canceled = False

    def cancel(self) -> None:
        """Cancel the chain, now or once it is accepted; without effect if it has ended."""
        self._is_canceled = True
        if self._handle is not None:
            self._handle.cancel_goal_async()

    def abandon(self, code: int, reason: str) -> None:
        """Cancel the chain if it has not ended, and replace its result by an outcome."""
        if not self.result.done():
            self.cancel()
            self._end(code, reason)

    def take_response(self, response: Future) -> None:
        """Take the executor's response to the goal."""
        handle = response.result()
        if not handle.accepted:
            self._end(Outcome.REFUSED, _REJECTED)
            return
        self._handle = handle
        handle.get_result_async().add_done_callback(self._take_result)
        if self._is_canceled:
            self.cancel()

    def _take_result(self, answer: Future) -> None:
        if not self.result.done():
            self.result.set_result(answer.result().result)

    def _end(self, code: int, reason: str) -> None:
        if not self.result.done():
            outcome = Outcome(code=code, reason=reason)
            self.result.set_result(ExecuteChain.Result(outcome=outcome))


class ChainClient:
    """Sends chains to the executor, which executes the newest one and ends the one before.

    Goals have a lease: the executor ends them when the client's node is gone. They are abandoned
    when the executor is gone, or was restarted and lost them.

    Parameters
    ----------
    node : Node
        The node of the client. It has to be spun.
    on_lost : callable
        Called with the reason when the executor is gone or was restarted: goals of all clients are
        lost.
    namespace : str
        That of the executor, relative to the node's own; empty: the same.
    """

    def __init__(
        self,
        node: Node,
        on_lost: Callable[[str], object] = lambda _: None,
        *,
        namespace: str = "",
    ) -> None:
        self._node = node
        self._on_lost = on_lost
        self._name = f"{namespace}/execute_chain" if namespace else "execute_chain"
        self._client = ActionClient(node, ExecuteChain, self._name, **ACTION_QUEUES)
        self._cancel = node.create_client(
            CancelGoal, f"{self._name}/_action/cancel_goal", qos_profile=SERVICES
        )
        self._lease = publish_lease(node)
        self._newest = SentChain()
        self._was_ready = False
        self._executors = 0  # action servers in the graph
        node.create_timer(_PERIOD, self._watch, clock=STEADY)

    def is_ready(self) -> bool:
        """Return whether the executor is there."""
        return bool(self._client.server_is_ready())

    def send(
        self, goal: ExecuteChain.Goal, on_feedback: Callable[[Any], object] = lambda _: None
    ) -> SentChain:
        """Send a goal, without waiting.

        `on_feedback` is called with each ExecuteChain.Feedback.
        """
        self._watch()
        self._newest = sent = SentChain()
        if not self._was_ready:
            sent.abandon(Outcome.INPUT_LOST, NO_EXECUTOR)
            return sent
        goal.lease = self._lease
        response = self._client.send_goal_async(
            goal,
            lambda message: on_feedback(message.feedback),
            goal_uuid=_goal_info(sent.chain_id).goal_id,
        )
        response.add_done_callback(sent.take_response)
        return sent

    def abandon(self, code: int, reason: str) -> None:
        """Cancel the newest goal if it has not ended, and replace its result by an outcome."""
        self._newest.abandon(code, reason)

    def cancel(self, chain_id: str) -> None:
        """Cancel a goal of any client by its id, without waiting."""
        self._cancel.call_async(CancelGoal.Request(goal_info=_goal_info(chain_id)))

    def _watch(self) -> None:
        """Abandon the newest goal if its executor is gone, or was restarted and lost it."""
        was_ready = self._was_ready
        self._was_ready = self.is_ready()
        # DDS lists an executor that was killed for up to 20 s. After a restart two are listed.
        previous = max(self._executors, 1)
        self._executors = self._node.count_services(f"{self._name}/_action/send_goal")
        if was_ready and not self._was_ready:
            self._lose(NO_EXECUTOR)
        elif self._executors > previous:
            self._lose(_RESTARTED)

    def _lose(self, reason: str) -> None:
        self._newest.abandon(Outcome.INPUT_LOST, reason)
        self._on_lost(reason)


def _goal_info(chain_id: str) -> GoalInfo:
    info = GoalInfo()
    info.goal_id.uuid = list(bytes.fromhex(chain_id))
    return info
