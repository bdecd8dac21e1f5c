"""Noticing that an action gets no nearer to its end."""

from __future__ import annotations

import math


class Progress:
    """Watches the estimated time to the goal.

    Parameters
    ----------
    patience : float
        Time in s without progress after which an action counts as stuck.
    """

    def __init__(self, patience: float = 10.0) -> None:
        self.patience = patience
        self._least = math.inf
        self._since = -math.inf

    def stuck(self, time: float, remaining: float) -> bool:
        """Take note of the estimated remaining time (s) at `time` (s) and say whether the action is stuck."""
        if remaining < self._least - 0.1 or math.isinf(self._since):
            self._least, self._since = remaining, time
        return time - self._since > self.patience
