"""From the description of a base with two driven wheels to a calibrated one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from ator_ros.bases.description import Robot
from ator_ros.bases.differential.identification import BaseEstimate, check_plausible, identify
from ator_ros.bases.differential.limits import GREATEST, Limits
from ator_ros.bases.differential.probe_drive import DriveSample, ProbeDrive
from ator_ros.bases.differential.robot import DifferentialRobot, differential, least_torque

_FACTOR = 1.5  # of commands to the described limits, so that odometry shows the limits of the base
_POINT_TOLERANCE = 0.03  # m; wheels that slide in turns move the axle by less


def probe_drive(robot: Robot, *, v: float | None, w: float | None, space: float) -> ProbeDrive:
    """Return the drive that measures a base.

    Raises ConfigError if the base has no two driven wheels.

    Parameters
    ----------
    robot : Robot
        What is assumed of the base until it is measured.
    v, w : float or None
        Greatest commands in m/s and rad/s; None: 1.5 times the limits of `robot`.
    space : float
        Free distance ahead of the robot in m.
    """
    base = differential(robot)
    return ProbeDrive(
        v=v or _FACTOR * base.limits.v,
        w=w or _FACTOR * base.limits.w,
        space=space,
        backward=base.limits.backward > 0.0,
    )


def calibrated(robot: Robot, samples: Sequence[DriveSample]) -> tuple[Robot, list[str]]:
    """Return `robot` as the samples of its probe drive show it, and lines that report it.

    Raises DriveError if an estimate cannot be right.
    """
    base = differential(robot)
    estimate = identify(samples)
    check_plausible(estimate)
    measured = described(base, estimate)
    lines = report(estimate)
    if measured.wheel_torque != base.wheel_torque:
        lines.append(
            f"wheel_torque {measured.wheel_torque:g} N m: the least that {measured.mass:g} kg need"
        )
    return measured, lines


def described(template: DifferentialRobot, estimate: BaseEstimate) -> DifferentialRobot:
    """Return the template with the estimated limits and lag; `v_back` is that of the template.

    The motors' torque is raised if it is too weak for the estimated accelerations.
    """
    rounded = {name: round(getattr(estimate.limits, name), 3) for name in GREATEST}
    limits = Limits(**rounded, v_back=template.limits.v_back)
    holder = template.holder
    if holder is not None:
        holder = dataclasses.replace(holder, limits=holder.limits.within(limits))
    torque = max(template.wheel_torque, least_torque(template.mass, template.wheel_radius, limits))
    return dataclasses.replace(
        template,
        limits=limits,
        motor_time_constant=round(max(estimate.lag, 0.002), 3),
        holder=holder,
        wheel_torque=torque,
    )


def report(estimate: BaseEstimate) -> list[str]:
    """Return the estimates as lines for the user."""
    limits = estimate.limits
    lines = [
        f"latency {estimate.latency:.3f} s: set the parameter `latency` of the executor",
        f"motor_time_constant {estimate.lag:.3f} s",
        f"limits: v {limits.v:.3f} m/s, w {limits.w:.3f} rad/s, a {limits.a:.3f} m/s^2, "
        f"brake {limits.brake:.3f} m/s^2, aw {limits.aw:.3f} rad/s^2",
    ]
    for name, axis, unit in (("v", estimate.driving, "m/s"), ("w", estimate.turning, "rad/s")):
        lines.append(
            f"dead zone of {name}: {axis.dead_zone:.2f} {unit}; fitted within "
            f"{axis.error:.3f} {unit} (RMS)"
        )
        if not axis.limited:
            lines.append(
                f"limits.{name}: {axis.response.limit:.3f} {unit} is the fastest speed in "
                f"odometry; the base may be faster (give more --space, or a greater --{name})"
            )
    ahead, left = estimate.point
    if math.hypot(ahead, left) > _POINT_TOLERANCE:
        lines.append(
            f"odometry describes a point {ahead:z.2f} m ahead and {left:z.2f} m to the left of the "
            "middle of the axle, but drives need that of the axle: correct the driver, or its "
            "robot_frame"
        )
    return lines
