"""An action server of another program, as the executor uses it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

from ator_ros.actions.base import Goal
from ator_ros.actions.remote import RemoteCall, failure_in
from ator_ros.nodes.remote_goal import RemoteGoal
from ator_ros.nodes.remote_messages import GoalWriter, RemoteError, action_type_of, check_result
from ator_ros.nodes.signs_of_life import SignsOfLife


class RemoteServer:
    """Sends goals to one action server, and knows which of them it may still be executing.

    Parameters
    ----------
    node : Node
        On whose behalf.
    call : RemoteCall
        What is declared of the server.
    frame : str
        The frame that states are estimated in.
    clock : callable
        Returns the real time in s.

    Attributes
    ----------
    name : str
        The server's name.
    timeouts : Timeouts
        How long it may take.
    fault : str
        Why it cannot be used, as where its type is not installed; empty where it can.
    """

    def __init__(self, node: Node, call: RemoteCall, frame: str, clock: Callable[[], float]) -> None:
        self.name, self.timeouts, self.clock = call.server, call.timeouts, clock
        self.fault = ""
        self._node, self._call = node, call
        self._seen = -math.inf
        self._ending: list[tuple[RemoteGoal, float]] = []
        try:
            kind: Any = action_type_of(call.type)
            self._writer = GoalWriter(call, kind.Goal, frame)
            check_result(call, kind.Result)
            self._client = ActionClient(node, kind, call.server)
            self._life = SignsOfLife(node, call.server, call.timeouts.silence)
        except (RemoteError, NameValidationException) as error:
            self.fault = f"action server {call.server}: {error}"

    def present(self, now: float) -> bool:
        """Return whether the server is there at `now`, in real s."""
        there = bool(self._client.server_is_ready())
        self._seen = now if there else self._seen
        return there

    def lost(self, now: float) -> bool:
        """Return whether the server has been missing for longer than it may."""
        return not self.present(now) and now - self._seen > self.timeouts.server

    def unusable(self, now: float) -> str:
        """Return why no goal can be sent now; empty where one can.

        A server that was killed counts until DDS has given it up, which takes 20 s.
        """
        within = f"expected one action server within {self.timeouts.server:g} s"
        if not self.present(now):
            return f"{self.name}: {within}, got none"
        servers = self._node.count_services(f"{self.name}/_action/send_goal")
        return f"{self.name}: {within}, got {servers}: each would move the robot" if servers > 1 else ""

    def send(self, goal: Goal) -> RemoteGoal:
        """Send a goal."""
        return RemoteGoal(self._client, self._writer.written(goal), self._life.heard)

    def accepted(self, now: float) -> None:
        """Watch over the server from `now` on, in real s: it has accepted a goal."""
        self._life.begin(now)

    def silent(self, now: float) -> bool:
        """Return whether the server that executes a goal has been silent for longer than it may."""
        return self._life.silence(now) > self.timeouts.silence

    def failure_of(self, sent: RemoteGoal) -> str | None:
        """Return in words why a goal with a result did not succeed; None where it did."""
        return failure_in(self._call, sent.status, sent.result)

    def release(self, sent: RemoteGoal) -> None:
        """Cancel a goal that may not be over; until it is, or its time is up, the server counts as ending."""
        now = self.clock()
        self._life.end()
        if not sent.over:
            sent.cancel()
            if self.present(now):
                self._ending.append((sent, now + self.timeouts.cancel))

    def ending(self) -> bool:
        """Return whether a canceled goal may still be executed."""
        self._ending = [(sent, until) for sent, until in self._ending if not sent.over]
        return bool(self._ending) and self.present(self.clock()) and not self._overdue()

    def remark(self) -> str:
        """Return, once, that the server has ignored a cancellation; empty where it has not."""
        if not (self._ending and self._overdue()):
            return ""
        self._ending = []
        return (
            f"{self.name} did not end its goal within {self.timeouts.cancel:g} s of its cancellation: "
            "it may still move the robot"
        )

    def _overdue(self) -> bool:
        return self.clock() > max(until for _, until in self._ending)
