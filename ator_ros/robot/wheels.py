"""How far the wheels of a differential-drive base have turned, from its velocities."""

from __future__ import annotations

import math

from ator_ros.robot.description import Robot

WHEEL_NAMES = ("left_wheel_joint", "right_wheel_joint")
"""The joints of the wheels in the URDF."""
_LONGEST_GAP = 0.5


class Wheels:
    """Integrates the turning of both wheels, as if they rolled without slipping.

    Parameters
    ----------
    robot : Robot
        Track and radius of the wheels.

    Attributes
    ----------
    angles : list of float
        Of the left and the right wheel in rad, in [-pi, pi).
    """

    def __init__(self, robot: Robot) -> None:
        self._half, self._radius = robot.track / 2.0, robot.wheel_radius
        self._time = math.nan
        self.angles = [0.0, 0.0]

    def roll(self, time: float, v: float, w: float) -> None:
        """Roll on to `time` s at v (m/s) and w (rad/s); over a gap or a jump of the clock they stand."""
        gap = time - self._time
        self._time = time
        if not 0.0 < gap <= _LONGEST_GAP:
            return
        for wheel, speed in enumerate((v - w * self._half, v + w * self._half)):
            self.angles[wheel] = math.remainder(self.angles[wheel] + gap * speed / self._radius, math.tau)
