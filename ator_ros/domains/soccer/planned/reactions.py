"""How a base reacts to commands: the speeds that it shows, beside those that its description lets expect."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from ator_ros.robot.description import Limits, Robot
from ator_ros.robot.response import ramped
from ator_ros.world.state import STOP, Command, RobotState, World


@dataclass(frozen=True, slots=True)
class Reaction:
    """What a base did in one tick.

    Attributes
    ----------
    passed : float
        Duration of the tick in s.
    before, set : Command
        Speeds at its beginning and end that the commands ask of a base as described, without any lag.
    was, now : RobotState
        States of the robot at its beginning and end.
    """

    passed: float
    before: Command
    set: Command
    was: RobotState
    now: RobotState


class Reactions:
    """Tells the reactions of a base to the commands that it is sent.

    Parameters
    ----------
    robot : Robot
        Limits within which the base should follow commands.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._last: World | None = None
        self._command, self._set = STOP, STOP

    def sent(self, command: Command) -> None:
        """Take in the command for the state that was seen last."""
        self._command = command

    def see(self, world: World) -> Reaction | None:
        """Return the reaction since the state that was seen last; None where this is the first one."""
        last, before = self._last, self._set
        self._last = world
        if last is None or world.time <= last.time:
            self._set = Command(world.robot.v, world.robot.w)
            return None
        passed = world.time - last.time
        self._set = ramped(before, self._command, passed, self._robot.limits, self._robot.stop)
        return Reaction(passed, before, self._set, last.robot, world.robot)


_LEAST_LAG_SHARE = 0.8  # of the described acceleration: with less of it a lag hardly shows
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
        if asked >= _LEAST_LAG_SHARE * self._robot.limits.a and gained >= _FOLLOWS * asked:
            short = 0.5 * (after + before - now - was)
            self._short += short * gained
            self._gained += gained * gained
            self._count += 1


_LEAST_STRENGTH_SHARE = 0.9  # of the described acceleration that is asked: with less, a weak base keeps up
_STEADY = 0.05  # by which a share changes from tick to tick where it is the strength's, not the lag's
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
        share = had / asked if abs(asked) >= _LEAST_STRENGTH_SHARE * self._limit else math.nan
        if share >= _HELD and abs(share - self._last) <= _STEADY:
            self._sum += share
            self._count += 1
        self._last = share
