"""One goal that was sent to an action server, from its sending until its result."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.task import Future

_FINAL = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)


class RemoteGoal:
    """A goal on its way. The node's executor brings the answers between two ticks; nothing here waits.

    Parameters
    ----------
    client : ActionClient
        Of the server.
    message : object
        The goal.
    heard : callable
        Called when feedback comes.

    Attributes
    ----------
    accepted : bool or None
        Whether the server took the goal; None: it has not answered.
    status : int
        The final state of the goal with the server, once there is a result.
    result : object or None
        The result; None: there is none.
    fault : str
        What went wrong with an answer; empty where nothing did.
    """

    def __init__(self, client: ActionClient, message: Any, heard: Callable[[], None]) -> None:
        self.accepted: bool | None = None
        self.status = GoalStatus.STATUS_UNKNOWN
        self.result: Any = None
        self.fault = ""
        self._handle: ClientGoalHandle | None = None
        self._canceled = False
        sent = client.send_goal_async(message, feedback_callback=lambda _: heard())
        sent.add_done_callback(self._take_answer)

    @property
    def over(self) -> bool:
        """Whether the server has nothing more to do for it, as far as is known."""
        ended = self._handle is not None and self._handle.status in _FINAL
        return self.accepted is False or self.result is not None or ended

    def cancel(self) -> None:
        """Ask the server to end it, now or when it is accepted after all."""
        if self._canceled or self.over:
            return
        self._canceled = True
        self._send_cancel()

    def _send_cancel(self) -> None:
        if self._handle is not None:
            with contextlib.suppress(RuntimeError):  # the node is being destroyed
                self._handle.cancel_goal_async()

    def _take_answer(self, future: Future) -> None:
        if self.accepted is not None:  # answered twice: the first answer counts
            return
        try:
            handle = future.result()
        except Exception as error:  # whatever another program's answer makes rclpy raise
            self.fault = f"its answer cannot be used: {error}"
            return
        self.accepted = bool(handle.accepted)
        if not self.accepted:
            return
        self._handle = handle
        handle.get_result_async().add_done_callback(self._take_result)
        if self._canceled:
            self._send_cancel()

    def _take_result(self, future: Future) -> None:
        if self.result is not None:
            return
        try:
            answer = future.result()
        except Exception as error:  # as above
            self.fault = f"its result cannot be used: {error}"
            return
        self.status, self.result = answer.status, answer.result
