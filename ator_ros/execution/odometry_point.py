"""Which point of the robot odometry describes: in turns, any but the axle's middle moves sideways."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ator_ros.geometry import Pose, wrap_angle

_STEP = 0.1  # rad; turn after which the sideways motion is measured: noise of 5 mm counts as 5 cm
_LARGEST_STEP = 0.6  # rad; above it, messages are missing, or the pose was reset
# m; in longer steps the curvature may change, which looks like sideways motion: with `_STEP`, arcs
# of a radius up to 1.5 m are measured
_LONGEST_STEP = 0.15
_SLOWEST_STEP = 0.5  # s; the same for the time of a step, if the robot hardly turns
_KEPT = 40  # greatest number of steps whose median counts
_FEWEST = 10  # least number of steps: a turn by 1 rad
_LEAST_AHEAD = 0.06  # m; with 0.05 m drives arrive, with 0.1 m some do not
_ROUNDED = 0.05  # m; so that the sentence rarely changes


class OdometryPoint:
    """Estimates how far ahead of the axle the point lies whose pose odometry gives.

    `remark` is a sentence on odometry of another point than the axle's middle, else empty.

    While a base with two driven wheels turns by an angle, the middle of its axle moves along the
    mean heading. A point d m ahead of it moves sideways by 2 d sin(angle / 2), too.
    """

    def __init__(self) -> None:
        self._begin: tuple[float, Pose] | None = None
        self._found: deque[float] = deque(maxlen=_KEPT)
        self.remark = ""

    def update(self, time: float, pose: Pose) -> None:
        """Process odometry of `time` (s)."""
        if self._begin is None:
            self._begin = time, pose
            return
        since, before = self._begin
        turned = wrap_angle(pose.yaw - before.yaw)
        far = before.distance(pose) > _LONGEST_STEP or abs(turned) > _LARGEST_STEP
        if far or not 0.0 <= time - since <= _SLOWEST_STEP:
            self._begin = time, pose
        elif abs(turned) >= _STEP:
            middle = before._replace(yaw=before.yaw + 0.5 * turned)
            self._found.append(middle.relative(pose).y / (2.0 * math.sin(0.5 * turned)))
            self._begin = time, pose
            self.remark = self._remark()

    def _remark(self) -> str:
        if len(self._found) < _FEWEST:
            return ""
        low, ahead, high = np.quantile(self._found, (0.25, 0.5, 0.75)).tolist()
        if not (low > _LEAST_AHEAD or high < -_LEAST_AHEAD):
            return ""
        side = "ahead of" if ahead > 0.0 else "behind"
        distance = _ROUNDED * round(abs(ahead) / _ROUNDED)
        return (
            f"odometry seems to describe a point about {distance:.2f} m {side} the axle, but drives "
            "need the pose of the axle's middle (`calibrate` measures it)"
        )
