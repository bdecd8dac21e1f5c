"""The time between two states of a base, and for how long something has been so (without ROS)."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

LONGEST_GAP = 0.1
"""Time in s between two states that counts: what happened in a longer one is not known."""
ROUNDING = 1e-6
_SHORTEST_WAIT = 0.1
"""Real s that commands need, in which simulated time may run far ahead."""


@dataclass(frozen=True, slots=True)
class Span:
    """The time between two states: s by the stamps, and when both came, in real time."""

    elapsed: float
    began: float
    ended: float
    share: float = 1.0
    """Of `elapsed`, what counts."""

    @property
    def seconds(self) -> float:
        """The time in s, by the stamps, that counts."""
        return self.share * self.elapsed

    @property
    def long(self) -> bool:
        """Whether the motion within the span is unknown."""
        return self.elapsed > LONGEST_GAP + ROUNDING

    def since(self, answered: float | None) -> Span:
        """Return the part of the span after the answer was sent, at `answered` in real s.

        A short span counts as a whole: a simulation may have waited for the answer.
        """
        late = -math.inf if answered is None else answered - self.began
        if late <= 0.0:
            return self
        took = self.ended - self.began
        share = max(0.0, 1.0 - late / took) if self.long and took > 0.0 else 1.0
        return dataclasses.replace(self, began=self.began + late, share=share)


class Stretch:
    """How long a condition has held without a break, by the stamps and in real time."""

    def __init__(self) -> None:
        self.seconds, self._since = 0.0, math.inf

    def lasts(self, so: bool, span: Span, longest: float) -> bool:
        """Add a span if the condition `so` holds, else reset; return whether `longest` (s) is reached."""
        if not so:
            self.seconds, self._since = 0.0, math.inf
            return False
        self._since = min(self._since, span.began)
        self.seconds += span.seconds
        return self.seconds >= longest - ROUNDING and span.ended - self._since >= _SHORTEST_WAIT - ROUNDING
