"""The response of an omnidirectional base to velocity commands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ator_ros.bases.omni.omni_limits import GREATEST, LEAST, OmniLimits, PlanarRates, extent
from ator_ros.geometry import Pose, clip, wrap_angle
from ator_ros.schema import Within
from ator_ros.world.state import STOP, Command, RobotState

_STEP = 0.01  # s of a step of the prediction
_ROUNDING = 1e-6  # steps


@dataclass(frozen=True, slots=True)
class OmniStop:
    """Deceleration of a base on a command to stop, which exceeds that of `OmniLimits`."""

    moving: Annotated[float, Within(LEAST, GREATEST["a"])] = 4.0  # m/s^2; in any direction
    turning: Annotated[float, Within(LEAST, GREATEST["aw"])] = 12.0  # rad/s^2


def within_limits(command: Command, limits: OmniLimits) -> Command:
    """Return a command whose velocity keeps its direction, and is at most the greatest there."""
    speed = math.hypot(command.vx, command.vy)
    most = limits.speed_towards(math.atan2(command.vy, command.vx))
    share = min(1.0, most / speed) if speed > 0.0 else 0.0
    return Command(share * command.vx, clip(command.w, limits.w), vy=share * command.vy)


def planar_ramp(
    velocity: Command, target: Command, dt: float, rates: PlanarRates, stop: OmniStop
) -> Command:
    """Return the set velocity of a base `dt` s after `velocity` if it is commanded to `target`.

    Both are in the robot's frame, which turns meanwhile. The velocity over the floor changes by no
    more than the limits allow.
    """
    turned = velocity.w * dt
    cos = math.cos(turned)
    sin = math.sin(turned)
    # The robot turns under the same velocity over the floor.
    vx = cos * velocity.vx + sin * velocity.vy
    vy = cos * velocity.vy - sin * velocity.vx
    change_x = target.vx - vx
    change_y = target.vy - vy
    size = math.hypot(change_x, change_y)
    most_turn = stop.turning if target == STOP else rates.aw
    if target == STOP:
        most = stop.moving
    else:
        loses = change_x * vx < 0.0
        ahead = rates.brake if loses else rates.a
        angle = math.atan2(change_y, change_x)
        most = extent(ahead, ahead, rates.a_side, angle, rates.box)
    share = min(1.0, most * dt / size) if size > 0.0 else 0.0
    return Command(
        vx + share * change_x,
        velocity.w + clip(target.w - velocity.w, most_turn * dt),
        vy=vy + share * change_y,
    )


def planar_moved(
    robot: RobotState,
    command: Command | None,
    seconds: float,
    limits: OmniLimits,
    stop: OmniStop,
) -> RobotState:
    """Return the robot after `seconds` of a command; None: at constant velocity in its frame."""
    x, y, yaw = robot.pose
    velocity = robot.velocity
    target = None if command is None else within_limits(command, limits)
    rates = limits.rates
    steps = math.ceil(seconds / _STEP - _ROUNDING)
    for _ in range(steps):
        dt = seconds / steps
        if target is not None:
            velocity = planar_ramp(velocity, target, dt, rates, stop)
        middle = yaw + 0.5 * velocity.w * dt
        cos = math.cos(middle)
        sin = math.sin(middle)
        x += dt * (cos * velocity.vx - sin * velocity.vy)
        y += dt * (sin * velocity.vx + cos * velocity.vy)
        yaw += velocity.w * dt
    pose = Pose(x, y, wrap_angle(yaw))
    return RobotState(pose, velocity.vx, velocity.w, vy=velocity.vy)
