"""An action server whose goals are driven by topics and timers instead of a callback that blocks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle

_RESULT_KEPT = 60
"""Time in s for which a result can be asked for. rclpy's 900 s keep hundreds of chains' records in memory."""


class DeferredActionServer(ActionServer):
    """Hands over accepted goals at once, as executing, and answers when `finish` is called.

    rclpy wants a callback per goal that returns the result: one that blocks needs a thread, and one that
    awaits makes rclpy's executor spin without a pause. Here nothing runs between two messages.

    Parameters
    ----------
    node, action_type, action_name
        As for ActionServer.
    start : callable
        Is given each goal that was accepted.
    cancel_callback : callable
        As for ActionServer.
    """

    def __init__(
        self,
        node: Any,
        action_type: Any,
        action_name: str,
        start: Callable[[ServerGoalHandle], None],
        *,
        cancel_callback: Callable[[ServerGoalHandle], Any],
    ) -> None:
        super().__init__(
            node,
            action_type,
            action_name,
            start,
            cancel_callback=cancel_callback,
            result_timeout=_RESULT_KEPT,
        )

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[[ServerGoalHandle], None] | None
    ) -> None:
        """Start a goal, which counts as executing from now on."""
        (execute_callback or self._execute_callback)(goal_handle)

    def finish(self, goal_handle: ServerGoalHandle, result: Any) -> None:
        """Answer a goal whose state is final."""
        super().notify_execute(goal_handle, lambda _: result)
