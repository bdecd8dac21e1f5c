"""The accelerations that a base shows while it drives."""

from __future__ import annotations

import dataclasses
import math

from ator_ros.domains.soccer.planned.reactions import Reaction
from ator_ros.robot.description import Limits, Robot

_LEAST_SHARE = 0.9  # of the described acceleration that is asked: with less, a weak base keeps up
_STEADY = 0.05  # by which a share changes from tick to tick where it is the strength's, not the lag's
_LEAST = 3  # ticks
_LONGEST_LAG = 0.1  # s, described, beyond which a few ticks do not tell weakness from lag
_WEAK, _HELD = 0.85, 0.3  # shares of what is asked below which a base is weak, or can't at all: at top speed
_USED = 0.97  # of what it has shown; the rest is for feedback
_STEP = 0.05  # to which shares are rounded, so that they settle


class StrengthSeen:
    """Estimates the acceleration of a base as a share of the described one, for driving and for turning.

    Where motors lag, a base gains less at first, then more from tick to tick. A weak one keeps gaining less.
    Of a base whose motors lag long as described nothing is estimated.

    Parameters
    ----------
    robot : Robot
        The accelerations that the base should have.
    limits : Limits
        What plans use of a base as described.
    """

    def __init__(self, robot: Robot, limits: Limits) -> None:
        self.described = limits
        self._tells = robot.motor_time_constant <= _LONGEST_LAG
        self._driving, self._turning = _Acceleration(robot.limits.a), _Acceleration(robot.limits.aw)

    @property
    def limits(self) -> Limits:
        """What plans may use: less where the base has shown that it is clearly weaker than described."""
        described, a, aw = self.described, self._driving.usable, self._turning.usable
        return dataclasses.replace(described, a=min(described.a, a), aw=min(described.aw, aw))

    @property
    def weak(self) -> bool:
        """Whether the base has shown that."""
        return self.limits != self.described

    def see(self, reaction: Reaction) -> None:
        """Take in what the base did in a tick."""
        if not self._tells:
            return
        before, after, passed = reaction.before, reaction.set, reaction.passed
        was, now = reaction.was, reaction.now
        # What it loses of its speed tells of the brakes.
        gain = after.v - before.v if abs(after.v) > abs(before.v) else 0.0
        self._driving.see(gain / passed, (now.v - was.v) / passed)
        self._turning.see((after.w - before.w) / passed, (now.w - was.w) / passed)


class _Acceleration:
    """Estimates one acceleration of the base, as a share of the described one, `limit`."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._last = math.nan
        self._sum, self._count = 0.0, 0

    @property
    def usable(self) -> float:
        """What plans may use: the described one unless the base has shown that it is weak."""
        if self._count < _LEAST or self._sum >= _WEAK * self._count:
            return self._limit
        return _USED * self._limit * _STEP * round(self._sum / self._count / _STEP)

    def see(self, asked: float, had: float) -> None:
        """Take in an acceleration that was asked, and the one that the base had."""
        share = had / asked if abs(asked) >= _LEAST_SHARE * self._limit else math.nan
        if share >= _HELD and abs(share - self._last) <= _STEADY:
            self._sum += share
            self._count += 1
        self._last = share
