"""An action server whose goals are driven by topics and timers instead of a blocking callback."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, GoalResponse
from rclpy.action.server import ServerGoalHandle

from ator_ros.nodes.bounded import bounded, with_parts
from ator_ros.nodes.pacing import Pace
from ator_ros.nodes.qos import SERVICES
from ator_ros.world.messages import MOST_ITEMS

_RESULT_KEPT = 60
"""Time in s for which a result is kept. rclpy's 900 s keep hundreds of chains' records in memory."""
MOST_KEPT = 300
"""Greatest number of goals whose results are kept."""
GOALS_PER_SECOND, GOALS_AT_ONCE = 20.0, 50
_WARNING_PERIOD = 2.0


class DeferredActionServer(ActionServer):
    """Hands over accepted goals at once, as executing, and answers when `finish` is called.

    rclpy expects one callback per goal that returns the result. A callback that blocks needs a thread, and
    one that awaits makes rclpy's executor spin without a pause. Here nothing runs between two messages.

    Goals beyond `GOALS_PER_SECOND` (after `GOALS_AT_ONCE`) or beyond `MOST_KEPT` in a minute are rejected,
    since each goal preempts the one before and its result is kept.

    Attributes
    ----------
    rejected : int
        Number of goals rejected for that reason.

    Parameters
    ----------
    node, action_type, action_name
        As for ActionServer.
    start : callable
        Called with each accepted goal.
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
        self.rejected = 0
        self._ends = False
        self._pace = Pace(time.monotonic, rate=GOALS_PER_SECOND, at_once=GOALS_AT_ONCE)
        super().__init__(
            node,
            action_type,
            action_name,
            start,
            goal_callback=self._admit,
            cancel_callback=cancel_callback,
            goal_service_qos_profile=SERVICES,
            result_service_qos_profile=SERVICES,
            cancel_service_qos_profile=SERVICES,
            result_timeout=_RESULT_KEPT,
        )
        sending = action_type.Impl.SendGoalService
        sending = with_parts(sending, Request=bounded(sending.Request, MOST_ITEMS))
        self._action_type = with_parts(
            action_type, Impl=with_parts(action_type.Impl, SendGoalService=sending)
        )

    def admit_no_more(self) -> None:
        """Reject all further goals: the node ends."""
        self._ends = True

    def _admit(self, _: Any) -> GoalResponse:
        if self._ends:
            return GoalResponse.REJECT
        kept = len(self._goal_handles)
        if kept < MOST_KEPT and self._pace.allows():
            return GoalResponse.ACCEPT
        self.rejected += 1
        self._node.get_logger().warning(
            f"goal rejected: busy: expected at most {GOALS_PER_SECOND:g} goals a second and {MOST_KEPT} in "
            f"{_RESULT_KEPT} s, got more",
            throttle_duration_sec=_WARNING_PERIOD,
        )
        return GoalResponse.REJECT

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[[ServerGoalHandle], None] | None
    ) -> None:
        """Start a goal, which is executing from now on."""
        (execute_callback or self._execute_callback)(goal_handle)

    def finish(self, goal_handle: ServerGoalHandle, result: Any) -> None:
        """Send the result of a goal whose state is final, and drop its request."""
        goal_handle._goal_request = type(goal_handle.request)()
        super().notify_execute(goal_handle, lambda _: result)
