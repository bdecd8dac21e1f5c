"""The delay of states: how much later than usual they are read, where stamps run with real time."""

from __future__ import annotations

import math
from collections import deque

# a clock runs with real time if the least delays of six steps, together 3 s, differ by at most 1 %
_STEP = 0.5  # real s
_STEPS = 6
_STEADY = 0.03  # s; 1 % of these steps
# real s over which the least delay counts as usual: clocks of two computers drift apart by 6 ms
_USUAL = 60.0
_RECENT = 0.2  # real s whose least delay is the present one: single messages may be late
_FEWEST = 3  # states whose least delay counts
_GAP = 1.0  # real s without a newer stamp after which a clock may have been paused


class Delay:
    """The delay of one clock's states beyond the usual one.

    A growing delay looks like a clock that becomes slower, as that of a simulation on a
    busy machine.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget the usual delay, until the clock has run with real time for 3 s."""
        self.is_known = False
        """Whether the usual delay is known."""
        self._last = -math.inf
        self._least: deque[tuple[float, float]] = deque()
        self._recent: deque[tuple[float, float]] = deque()

    def update(self, time: float, now: float) -> None:
        """Process a state with a newer stamp `time` (s), which is read at `now` in real s."""
        if now - self._last > _GAP:
            self.restart()
        self._last = now
        offset = now - time
        self._recent.append((now, offset))
        while len(self._recent) > _FEWEST and now - self._recent[0][0] > _RECENT:
            self._recent.popleft()
        if self._least and now - self._least[-1][0] < _STEP:
            since, least = self._least[-1]
            self._least[-1] = since, min(least, offset)
        else:
            self.is_known = self.is_known or self._is_steady()
            self._least.append((now, offset))
        while now - self._least[0][0] > _USUAL:
            self._least.popleft()

    def _is_steady(self) -> bool:
        """Return whether the delay has been constant in the last steps; forget those before."""
        while len(self._least) > _STEPS:
            self._least.popleft()
        offsets = [offset for _, offset in self._least]
        return len(offsets) == _STEPS and max(offsets) - min(offsets) <= _STEADY

    @property
    def seconds(self) -> float:
        """The delay in s beyond the usual one; 0 where stamps do not run with real time."""
        if not self.is_known:
            return 0.0
        usual = min(offset for _, offset in self._least)
        return min(offset for _, offset in self._recent) - usual
