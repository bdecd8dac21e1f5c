"""The delay of states: how much later than usual they are read, where stamps run with real time."""

from __future__ import annotations

import math
from collections import deque

_SETTLED = 2.0  # real s for which stamps must have run with real time before a delay is known
_REAL_TIME = 0.05  # greatest share by which their pace may then differ from it
# real s over which the least delay counts as usual: clocks of two computers drift apart by 6 ms
_USUAL, _STEP = 60.0, 1.0
_RECENT = 0.2  # real s whose least delay is the present one: single messages may be late
_FEWEST = 3  # states whose least delay counts
_DISTRUST = 600.0  # real s for which a clock that became slower may do so again
_GAP = 1.0  # real s without a newer stamp after which a clock may have been paused


class Delay:
    """The delay of one clock's states beyond the usual one.

    A growing delay cannot be told from a clock that becomes slower, as that of a simulation on a
    busy machine. `restart` makes the present delay the usual one; `distrust` says that the clock
    was found to become slower.
    """

    def __init__(self) -> None:
        self._distrusted_until = -math.inf
        self.restart()

    def restart(self) -> None:
        """Forget the usual delay."""
        self._begin: tuple[float, float] | None = None
        self._is_known = False
        self._last = -math.inf
        self._least: deque[tuple[float, float]] = deque()
        self._recent: deque[tuple[float, float]] = deque()

    def distrust(self) -> None:
        """Restart; the delay is unknown for ten minutes."""
        self._distrusted_until = self._last + _DISTRUST
        self.restart()

    def update(self, time: float, now: float) -> None:
        """Process a state with a newer stamp `time` (s), which is read at `now` in real s."""
        if now - self._last > _GAP:
            self.restart()
        self._last = now
        begin = self._begin = self._begin or (now, time)
        if not self._is_known and now - begin[0] >= _SETTLED:
            pace = (time - begin[1]) / (now - begin[0])
            self._is_known = abs(pace - 1.0) <= _REAL_TIME
            if not self._is_known:
                self.restart()
                self._last, self._begin = now, (now, time)
        offset = now - time
        self._recent.append((now, offset))
        while len(self._recent) > _FEWEST and now - self._recent[0][0] > _RECENT:
            self._recent.popleft()
        if self._least and now - self._least[-1][0] < _STEP:
            since, least = self._least[-1]
            self._least[-1] = since, min(least, offset)
        else:
            self._least.append((now, offset))
        while now - self._least[0][0] > _USUAL:
            self._least.popleft()

    @property
    def seconds(self) -> float:
        """The delay in s beyond the usual one; 0 where stamps do not run with real time."""
        if not self._is_known or self._last < self._distrusted_until:
            return 0.0
        usual = min(offset for _, offset in self._least)
        return min(offset for _, offset in self._recent) - usual
