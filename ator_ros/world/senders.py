"""Recognizes two senders of a topic or a transform by positions that jump to and fro."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

_LEAST_DISTANCE = 0.02  # m between two senders of a topic; the noise of odometry is below
# m between two senders in tf: detections of depth cameras, and corrections of localization, flip by
# the 3 to 5 cm of a cell
_LEAST_IN_TF = 0.2
LEAST_IN_ODOMETRY = 0.04
"""Distance in m of two senders of a frame in odom, which moves without jumps (REP-105)."""
# least share of a jump by which both neighbors seem to jump back: simulated senders, every second
# to fifth message of one of them, with uneven stamps, reach it
_LEAST_RETURN = 0.1
_MOST_VARIATION = 0.3  # greatest share by which jumps differ: by 0.25 with the same uneven stamps
# jumps of this kind in a row: white noise of one sender made at most 7 in 30,000 messages
_FEWEST_JUMPS = 8
# s without such a jump after which one of the two has ended; also a sender of 1 Hz has not
_LONGEST_PAUSE = 1.5


class SenderCheck:
    """Recognizes that positions come from two senders.

    The graph of ROS is the condition: `is_shared` returns whether it lists two publishers of the
    topic. The positions confirm that both send: they jump to and fro, always as far. Positions of
    one sender may do so, too, as those of a camera whose depths are rounded, and the graph lists
    publishers that have ended for up to 20 s.

    Without `is_shared`, as in tf, whose senders are unknown, jumps of at least `least` m count
    alone.
    """

    def __init__(
        self, is_shared: Callable[[], bool] | None = None, *, least: float = _LEAST_IN_TF
    ) -> None:
        self._is_shared = is_shared
        self._least = least if is_shared is None else _LEAST_DISTANCE
        # times in s, and positions in m as complex numbers x + yi
        self._positions: deque[tuple[float, complex]] = deque(maxlen=3)
        # differences of positions from the lines between those before and after
        self._deviations: deque[complex] = deque(maxlen=3)
        self._jump = 0j  # the last one
        self._jumped_at = -math.inf  # s
        self._jumps = 0

    def distance(
        self,
        time: float,
        x: float,
        y: float,
    ) -> float:
        """Process a position (m) at `time` (s); return the distance in m of two senders, or 0."""
        self._positions.append((time, complex(x, y)))
        if len(self._positions) == 3:
            self._deviations.append(_deviation(*self._positions))
        if len(self._deviations) == 3:
            self._count(time, *self._deviations)
        if abs(time - self._jumped_at) > _LONGEST_PAUSE:
            self._jumps = 0
        jumps = self._jumps >= _FEWEST_JUMPS
        is_shared = jumps and (self._is_shared is None or self._is_shared())
        return abs(self._jump) if is_shared else 0.0

    def _count(
        self,
        time: float,
        before: complex,
        jump: complex,
        after: complex,
    ) -> None:
        """Count the jump in the middle of three differences if it is one to another sender."""
        size = abs(jump)
        back = min(-_dot(jump, before), -_dot(jump, after))
        if size < self._least or back < _LEAST_RETURN * size * size:
            return
        # From the first sender to the second it points the other way than back.
        sign = math.copysign(1.0, _dot(jump, self._jump))
        is_same = abs(jump - sign * self._jump) <= _MOST_VARIATION * size
        self._jumps = self._jumps + 1 if is_same else 1
        self._jump = jump
        self._jumped_at = time


def _deviation(
    before: tuple[float, complex],
    here: tuple[float, complex],
    after: tuple[float, complex],
) -> complex:
    """Return how far a position lies from the line between two others, by their times (s)."""
    span = after[0] - before[0]
    share = min(max((here[0] - before[0]) / span, 0.0), 1.0) if span > 0.0 else 0.5
    return here[1] - before[1] - share * (after[1] - before[1])


def _dot(one: complex, other: complex) -> float:
    return one.real * other.real + one.imag * other.imag


class PoseSenderCheck:
    """Recognizes that poses come from two senders, which may differ in their heading only.

    `is_shared` and `least` (m, of positions): see `SenderCheck`.
    """

    def __init__(
        self, is_shared: Callable[[], bool] | None = None, *, least: float = _LEAST_IN_TF
    ) -> None:
        self._positions = SenderCheck(is_shared, least=least)
        self._headings = SenderCheck(is_shared)

    def difference(
        self,
        time: float,
        x: float,
        y: float,
        yaw: float,
    ) -> str:
        """Process a pose (m, rad) at `time` (s); return the difference of two senders, with unit.

        It is empty for one sender.
        """
        distance = self._positions.distance(time, x, y)
        # A heading is a position on the circle of radius 1 m, where 0.2 m are 0.2 rad.
        chord = self._headings.distance(time, math.cos(yaw), math.sin(yaw))
        if distance > 0.0:
            return f"{distance:.2f} m"
        if chord > 0.0:
            return f"{2.0 * math.asin(min(0.5 * chord, 1.0)):.2f} rad"
        return ""
