"""Whether an action server that executes a goal is still there.

DDS counts a server that was killed for up to 20 s. So the server is asked something harmless now and then: to
cancel a goal that nobody has sent. Each server answers that at once, except one that has no thread left for
it while it drives; that one has never answered during a goal, and its silence means nothing.
"""

from __future__ import annotations

import math
from typing import Any

from rclpy.node import Node
from rclpy.task import Future

from ator_ros.nodes.meeting import meeting_client, nobodys_goal

_QUESTIONS = 6
"""Questions within the longest silence."""
_SHORTEST = 0.05
"""Least real s between two of them."""


class SignsOfLife:
    """Asks the server of one action, one question at a time.

    A server that was restarted does not answer what its predecessor was asked: it does not know the goal
    either.

    Parameters
    ----------
    node : Node
        Who asks.
    action : str
        The name of the action.
    longest : float
        Real s of silence that are not exceeded by a server that lives.
    """

    def __init__(self, node: Node, action: str, longest: float) -> None:
        self._period = max(longest / _QUESTIONS, _SHORTEST)
        self._client: Any = meeting_client(node, action)
        self._asked: Future | None = None
        self._answers = False
        self._next = self._looked = math.inf
        self._quiet = 0.0

    def begin(self, now: float) -> None:
        """Begin to ask at `now`, in real s: a goal was accepted."""
        self.end()
        self._next, self._looked, self._quiet = now + self._period, now, 0.0

    def heard(self) -> None:
        """Take another sign of life, as feedback."""
        self._quiet = 0.0

    def silence(self, now: float) -> float:
        """Return for how many real s nothing has been heard at `now`; 0 of one who never answers."""
        # What came while we ourselves were stalled has not been read yet: a long time counts less.
        self._quiet += min(max(now - self._looked, 0.0), self._period)
        self._looked = now
        if self._asked is None and now >= self._next:
            self._next = now + self._period
            self._asked = self._client.call_async(nobodys_goal())
            self._asked.add_done_callback(self._take_answer)
        return self._quiet if self._answers else 0.0

    def _take_answer(self, future: Future) -> None:
        if future is self._asked:
            self._asked, self._answers = None, True
            self.heard()

    def end(self) -> None:
        """Stop asking: the goal is over."""
        asked, self._asked = self._asked, None
        if asked is not None and not asked.done():
            self._client.remove_pending_request(asked)
