"""How a base follows velocity commands: within its limits, except that a stop brakes harder."""

from __future__ import annotations

from ator_ros.robot.description import Limits, StopBraking
from ator_ros.world.state import STOP, Command


def ramped(speeds: Command, target: Command, dt: float, limits: Limits, stop: StopBraking) -> Command:
    """Return the velocities after `dt` s of a base that changes from `speeds` toward `target`."""
    if target == STOP:
        most = Command(_braking(speeds.v, stop), stop.turning)
    else:
        losing = abs(target.v) < abs(speeds.v) or target.v * speeds.v < 0.0
        most = Command(limits.brake if losing else limits.a, limits.aw)
    return Command(
        speeds.v + clip(target.v - speeds.v, most.v * dt), speeds.w + clip(target.w - speeds.w, most.w * dt)
    )


def stopping_way(v: float, stop: StopBraking) -> float:
    """Return the signed stopping distance in m at `v` (m/s) after a command to stop."""
    return v * abs(v) / (2.0 * _braking(v, stop))


def _braking(v: float, stop: StopBraking) -> float:
    return stop.backward if v < 0.0 else stop.forward


def clip(value: float, bound: float) -> float:
    """Return `value` clipped to [-bound, bound]."""
    return max(-bound, min(bound, value))
