"""The base's firmware: clips commands, ramps them, and stops when they cease."""

from __future__ import annotations

import math

from ator_ros.robot.description import Robot
from ator_ros.robot.ramp import clip, ramped
from ator_ros.world.state import STOP, Command

COMMAND_TIMEOUT = 0.15
"""Time in s that a command holds: three ticks."""
_ROUNDING = 1e-6


class BaseController:
    """Turns velocity commands into wheel speeds as the firmware of a real base does.

    Velocities change within the robot's limits, but a stop is a stop: where the command is to stand, or none
    has come for 0.15 s, the base brakes as hard as it can without tipping. So the robot stands 0.5 s after
    the last command, from any speed and turn within its limits.

    Parameters
    ----------
    robot : Robot
        Limits, wheel radius and track.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._command = STOP
        self._expires = -math.inf
        self.setpoint = STOP

    def reset(self, setpoint: Command = STOP) -> None:
        """Forget the command; the base now moves at `setpoint` and slows down unless commanded."""
        self._command, self._expires, self.setpoint = STOP, -math.inf, setpoint

    def command(self, command: Command, time: float) -> None:
        """Accept a command at `time` (s); it holds for 0.15 s.

        Raises
        ------
        ValueError
            The command is not finite.
        """
        if not (math.isfinite(command.v) and math.isfinite(command.w)):
            raise ValueError(
                f"command: expected finite velocities, got v={command.v} m/s, w={command.w} rad/s"
            )
        limits = self._robot.limits
        self._command = Command(clip(command.v, limits.v), clip(command.w, limits.w))
        self._expires = time + COMMAND_TIMEOUT - _ROUNDING

    def ramp(self, time: float, dt: float) -> tuple[float, float]:
        """Move the setpoint toward the command for `dt` s; return the left and right wheel speed in rad/s."""
        target = self._command if time < self._expires else STOP
        self.setpoint = ramped(self.setpoint, target, dt, self._robot.limits, self._robot.stop)
        turn = self.setpoint.w * self._robot.track / 2.0
        radius = self._robot.wheel_radius
        return (self.setpoint.v - turn) / radius, (self.setpoint.v + turn) / radius
