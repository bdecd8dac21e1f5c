"""The chain that a view lets an executor execute."""

from __future__ import annotations

import math
import threading
import uuid
from collections import deque
from functools import partial
from typing import Any

from action_msgs.msg import GoalInfo
from rclpy.action import ActionClient
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, Outcome
from ator_ros.execution.supervisor import Phase
from ator_ros.nodes.qos import RESULTS
from ator_ros.nodes.silence import Silence, lose
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.viewing.runs import Run
from ator_ros.viewing.stage import StageError

_MOST_SENT = 100


class LiveChain:
    """Sends chains to the executor, one at a time, and tells a run how its chain goes.

    Parameters
    ----------
    own : SpunNode
        Not started yet.
    """

    def __init__(self, own: SpunNode) -> None:
        self._own = own
        self._run: Run | None = None
        self._goal: Any = None
        self._steered = False
        self._silence = Silence()
        self._sent = deque[str](maxlen=_MOST_SENT)
        self._server = ActionClient(own.node, ExecuteChain, "execute_chain")
        own.node.create_subscription(ActionPerformance, "performance/action", self._take_action, RESULTS)

    def ready(self) -> None:
        """Wait until the executor answers; raises StageError if it does not in time."""
        self._own.until(self._server.server_is_ready, "the action execute_chain")
        self._own.meet("execute_chain")

    def is_ours(self, chain_id: str) -> bool:
        """Return whether a chain of this identifier was sent from here."""
        return chain_id in tuple(self._sent)

    def _take_action(self, message: ActionPerformance) -> None:
        run = self._run
        if run is not None and not run.ended and message.outcome.code == Outcome.SUCCEEDED:
            run.actual.append(message.actual.duration)

    def execute(self, run: Run, goal: ExecuteChain.Goal) -> None:
        """Send a chain, and wait until the executor steers; raises StageError if it does not."""
        if not self._server.server_is_ready():
            raise StageError("expected the action execute_chain, it is not there")
        self._run, self._goal, self._steered, self._silence = run, None, False, Silence()
        told = threading.Event()

        def hear(feedback: Any) -> None:
            run.status = f"{feedback.feedback.top}: {feedback.feedback.status}"
            self._steered = feedback.feedback.status.startswith(Phase.EXECUTING.value)
            self._silence.broken()
            told.set()

        name = uuid.uuid4()
        self._sent.append(name.hex)  # before anything is told of it
        own = GoalInfo().goal_id
        own.uuid = list(name.bytes)
        future = self._own.within(
            lambda: self._server.send_goal_async(goal, feedback_callback=hear, goal_uuid=own)
        )
        self._goal = handle = self._own.answer(future, "execute_chain")
        if not handle.accepted:
            raise StageError("the executor accepts no goal")
        ended = self._own.within(handle.get_result_async)
        ended.add_done_callback(partial(_finish, run))
        try:
            self._own.until(lambda: told.is_set() or ended.done(), "feedback of execute_chain")
        except StageError:
            self._own.within(handle.cancel_goal_async)  # it may have begun, and nobody would watch it
            raise

    @property
    def under_way(self) -> bool:
        """Whether there is a chain that could be cancelled."""
        return self._run is not None and not self._run.ended and self._goal is not None

    def cancel(self) -> None:
        """Cancel the chain under way; wait until it has ended. Raises StageError where nobody answers."""
        run, handle = self._run, self._goal
        assert run is not None
        try:
            self._own.within(handle.cancel_goal_async)
            self._own.until(lambda: run.ended, "the end of the chain")
        finally:
            if not run.ended:  # whoever executed it is gone; nothing will end it any more
                lose(run)

    def watch(self, stamp: float) -> None:
        """Count the chain under way as lost where its executor is gone, or silent.

        Parameters
        ----------
        stamp : float
            Time in s of the robot's newest state; while it stands nobody has anything to tell.
        """
        run, there = self._run, self._server.server_is_ready()
        if run is None or not self.under_way:
            return
        if there and not self._steered:  # what waits for refinement tells nothing
            self._silence.broken()
        if self._silence.is_too_long(stamp, there=there):
            lose(run)


def _finish(run: Run, future: Future) -> None:
    answer = future.result()
    if answer is None:
        run.status = "no result"
    else:
        record = answer.result.record
        is_done = answer.result.outcome.code == Outcome.SUCCEEDED
        run.actual[:] = [action.actual.duration for action in record.actions]
        run.duration = record.actual.duration if is_done else math.nan
        run.status = f"{'done' if is_done else answer.result.outcome.reason} ({record.refinement})"
    run.ended = True
