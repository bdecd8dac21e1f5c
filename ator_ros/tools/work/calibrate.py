"""Estimate a base from half a minute of driving, and write its description."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence

import yaml

from ator_ros.files import head, portable_command, write_text
from ator_ros.robot.description import KIND, Limits, Robot, least_torque, load_robot
from ator_ros.robot.identification import BaseEstimate, identify
from ator_ros.robot.probe_drive import ProbeDrive
from ator_ros.tools.work.calibration_drive import drive_over_ros

_FASTER = 1.5  # commands beyond the described limits, so that the limits of the base show


def run(options: argparse.Namespace, words: Sequence[str]) -> int:
    """Do what the command line asks for; return the exit code."""
    robot = load_robot(options.robot)
    limits = robot.limits
    drive = ProbeDrive(
        v=options.v or _FASTER * limits.v, w=options.w or _FASTER * limits.w, space=options.space
    )
    samples = drive_over_ros(drive, words, stamped=options.stamped, frame=options.frame)
    estimate = identify(samples)
    found = described(dataclasses.replace(robot, name=options.name or robot.name), estimate)
    told = report(estimate)
    if found.wheel_torque != robot.wheel_torque:
        told.append(
            f"wheel_torque {found.wheel_torque:g} N m: the least that {found.mass:g} kg need for that"
        )
    lines = [f"# {line}" for line in ("Written by:", portable_command("calibrate", words), *told)]
    write_text(
        options.out,
        "\n".join(lines) + "\n" + yaml.safe_dump({**head(KIND), **found.sections()}, sort_keys=False),
    )
    load_robot(options.out)  # raises ConfigError where an estimate is not plausible
    print("\n".join((*told, f"written to {options.out}")))
    return 0


def described(template: Robot, estimate: BaseEstimate) -> Robot:
    """Return a description with the estimated limits and lag, and everything else of the template.

    Motors that the template has too weak for the estimated accelerations are as strong as they must be.
    """
    limits = Limits(*(round(value, 3) for value in dataclasses.astuple(estimate.limits)))
    lag, holder = round(max(estimate.lag, 0.002), 3), template.holder
    if holder is not None:
        holder = dataclasses.replace(holder, limits=holder.limits.within(limits))
    torque = max(template.wheel_torque, least_torque(template.mass, template.wheel_radius, limits))
    return dataclasses.replace(
        template, limits=limits, motor_time_constant=lag, holder=holder, wheel_torque=torque
    )


def report(estimate: BaseEstimate) -> list[str]:
    """Return the estimates as readable lines."""
    limits, axes = estimate.limits, (("v", estimate.driving, "m/s"), ("w", estimate.turning, "rad/s"))
    lines = [
        f"latency {estimate.latency:.3f} s: set the parameter `latency` of the executor",
        f"motor_time_constant {estimate.lag:.3f} s",
        f"limits: v {limits.v:.3f} m/s, w {limits.w:.3f} rad/s, a {limits.a:.3f} m/s^2, "
        f"brake {limits.brake:.3f} m/s^2, aw {limits.aw:.3f} rad/s^2",
    ]
    for name, axis, unit in axes:
        lines.append(
            f"dead zone of {name}: {axis.dead_zone:.2f} {unit}; fitted within {axis.error:.3f} {unit} (RMS)"
        )
        if not axis.limited:
            lines.append(
                f"limits.{name}: {axis.response.limit:.3f} {unit} is what was driven; "
                f"the base may be faster (give more --space, or a greater --{name})"
            )
    return lines
