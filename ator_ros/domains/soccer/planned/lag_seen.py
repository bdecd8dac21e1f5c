"""The lag of the motors that a base shows while it drives."""

from __future__ import annotations

from ator_ros.robot.description import Robot
from ator_ros.robot.ramp import ramped
from ator_ros.world.state import STOP, Command, World

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
        Limits within which the base follows commands, and the lag that is expected.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._last: World | None = None
        self._command, self._set = STOP, STOP
        self._short, self._gained, self._count = 0.0, 0.0, 0

    @property
    def seconds(self) -> float:
        """Time constant in s: the described one unless the base has shown a much longer one."""
        described = self._robot.motor_time_constant
        if self._count < _LEAST or self._short < (described + _SURPRISE) * self._gained:
            return described
        return min(self._short / self._gained, _MOST)

    def sent(self, command: Command) -> None:
        """Take in the command for the state that was seen last."""
        self._command = command

    def see(self, world: World) -> None:
        """Take in the state of this tick."""
        last, before = self._last, self._set
        self._last = world
        if last is None or world.time <= last.time:
            self._set = Command(world.robot.v, world.robot.w)
            return
        robot, passed = self._robot, world.time - last.time
        self._set = ramped(before, self._command, passed, robot.limits, robot.stop)
        was, now = abs(last.robot.v), abs(world.robot.v)
        asked, gained = (abs(self._set.v) - abs(before.v)) / passed, (now - was) / passed
        if asked >= _LEAST_SHARE * robot.limits.a and gained >= _FOLLOWS * asked:
            short = 0.5 * (abs(self._set.v) + abs(before.v) - now - was)
            self._short += short * gained
            self._gained += gained * gained
            self._count += 1
