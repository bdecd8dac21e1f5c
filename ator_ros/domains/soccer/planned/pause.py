"""Standing still while a plan is made: brakes as gently as a plan would, so that a held ball stays."""

from __future__ import annotations

import math

from ator_ros.robot.description import Limits
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, RobotState, World

_SETTLING = 0.3  # s after which a base counts as standing whatever its odometry says


class Pause:
    """Brings a robot to rest.

    Parameters
    ----------
    world : World
        The state in which it begins.
    limits : Limits
        How hard it may brake.
    """

    def __init__(self, world: World, limits: Limits) -> None:
        self._from: RobotState = world.robot
        self._since = world.time
        self._limits = limits

    def command(self, world: World) -> Command:
        """Return the command of this tick."""
        elapsed = world.time - self._since + CONTROL_PERIOD
        return Command(
            _slowed(self._from.v, self._limits.brake * elapsed),
            _slowed(self._from.w, self._limits.aw * elapsed),
        )

    def over(self, world: World) -> bool:
        """Return whether the robot stands."""
        patient = world.time - self._since < abs(self._from.v) / self._limits.brake + _SETTLING
        return world.robot.is_still or (self.command(world) == STOP and not patient)


def _slowed(speed: float, loss: float) -> float:
    return math.copysign(max(0.0, abs(speed) - loss), speed)
