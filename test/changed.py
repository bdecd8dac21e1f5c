"""Robots whose physics differs from their description, for evaluations of learning."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from ator_ros.robot.description import Limits, Robot


@dataclass(frozen=True)
class Changed:
    """An undescribed change of the robot.

    Attributes
    ----------
    acceleration : float
        Acceleration of driving and turning as a share of the described one; braking is unchanged.
    lag : float
        Time constant of the motors in s; 0: as described.
    """

    acceleration: float = 1.0
    lag: float = 0.0

    def robot(self, described: Robot) -> Robot:
        """Return the simulated robot; actions still plan with the described one."""
        limits, share = described.limits, self.acceleration
        slower = Limits(limits.v, limits.w, share * limits.a, limits.brake, share * limits.aw)
        lag = self.lag or described.motor_time_constant
        return dataclasses.replace(described, limits=slower, motor_time_constant=lag)


CHANGES: dict[str, Changed] = {
    "none": Changed(),
    "motors": Changed(acceleration=0.7),
    "lag": Changed(lag=0.12),
}
"""No change; 70 % of the motors' acceleration; motors that lag by 0.12 s."""
