"""How a base follows velocity commands: within its limits, except that a stop brakes harder."""

from __future__ import annotations

from ator_ros.robot.description import Limits
from ator_ros.world.state import STOP, Command

_STOP_FORWARD = Command(v=4.0, w=12.0)
"""Decelerations of a stop in m/s² and rad/s²; from 4.5 m/s² on the robot's rear lifts."""
_STOP_BACKWARD = Command(v=5.0, w=12.0)
"""Decelerations of a stop from backward driving, where nothing lifts; turning wheels slip and need time."""


def ramped(speeds: Command, target: Command, dt: float, limits: Limits) -> Command:
    """Return the velocities after `dt` s of a base that changes from `speeds` toward `target`."""
    if target == STOP:
        most = _STOP_BACKWARD if speeds.v < 0.0 else _STOP_FORWARD
    else:
        losing = abs(target.v) < abs(speeds.v) or target.v * speeds.v < 0.0
        most = Command(limits.brake if losing else limits.a, limits.aw)
    return Command(
        speeds.v + clip(target.v - speeds.v, most.v * dt), speeds.w + clip(target.w - speeds.w, most.w * dt)
    )


def stopping_way(v: float) -> float:
    """Return the signed stopping distance in m at `v` (m/s) after a command to stop."""
    return v * abs(v) / (2.0 * (_STOP_BACKWARD if v < 0.0 else _STOP_FORWARD).v)


def clip(value: float, bound: float) -> float:
    """Return `value` clipped to [-bound, bound]."""
    return max(-bound, min(bound, value))
