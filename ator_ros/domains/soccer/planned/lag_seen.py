"""The lag of the motors that a base shows while it drives."""

from __future__ import annotations

from ator_ros.domains.soccer.planned.reactions import Reaction
from ator_ros.robot.description import Robot

_LEAST_SHARE = 0.8  # of the described acceleration: with less of it a lag hardly shows
_FOLLOWS = 0.8  # share of the set speed's change with which a base follows that lags, and is not weak
_LEAST = 3  # ticks
_SURPRISE = 0.03  # s beyond the described lag: the Pioneer as described shows 0.005 s more at most
_MOST = 0.2  # s


class LagSeen:
    """Estimates a first-order lag by least squares, from speeds that fall short of set speeds that rise.

    A base that gains speed more slowly than it should is weak; only one that keeps up tells of its lag.

    Parameters
    ----------
    robot : Robot
        The acceleration that the base should have, and the lag that is expected.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._short, self._gained, self._count = 0.0, 0.0, 0

    @property
    def seconds(self) -> float:
        """Time constant in s: the described one unless the base has shown a much longer one."""
        described = self._robot.motor_time_constant
        if self._count < _LEAST or self._short < (described + _SURPRISE) * self._gained:
            return described
        return min(self._short / self._gained, _MOST)

    def see(self, reaction: Reaction) -> None:
        """Take in what the base did in a tick."""
        before, after, passed = abs(reaction.before.v), abs(reaction.set.v), reaction.passed
        was, now = abs(reaction.was.v), abs(reaction.now.v)
        asked, gained = (after - before) / passed, (now - was) / passed
        if asked >= _LEAST_SHARE * self._robot.limits.a and gained >= _FOLLOWS * asked:
            short = 0.5 * (after + before - now - was)
            self._short += short * gained
            self._gained += gained * gained
            self._count += 1
