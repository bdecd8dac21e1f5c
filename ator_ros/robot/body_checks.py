"""Which descriptions no body can have: sizes, masses and motors that do not go with each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ator_ros.robot.description import Limits, Robot

_LOOSE = 2.0
"""Fingers farther apart than so many widths of what they hold do not hold it."""
_SAME_RADIUS = 0.1
"""Share by which the radius of an object may differ from the one that the holder is made for."""


def impossible(robot: Robot) -> str | None:
    """Return what is wrong first with a body, as field, expectation and value; None if it is sound."""
    return next(_wrong(robot), None)


def _wrong(robot: Robot) -> Iterator[str]:
    yield from _wrong_build(robot)
    yield from _wrong_motors(robot)
    if robot.track > 2.0 * robot.half_width:
        width = f"at most {2.0 * robot.half_width:g}, the width of the robot with its wheels"
        yield f"robot.track: expected {width}, got {robot.track:g}"
    yield from _wrong_holder(robot)


def _wrong_build(robot: Robot) -> Iterator[str]:
    wheel, behind, caster = robot.build.wheel_mass, robot.build.mass_behind, robot.build.caster_behind
    if wheel is not None and 2.0 * wheel >= robot.mass:
        yield f"robot.build.wheel_mass: expected less than {robot.mass / 2.0:g}, got {wheel:g}"
    if caster is not None and caster > robot.rear:
        end = f"at most {robot.rear:g}, where the robot ends"
        yield f"robot.build.caster_behind: expected {end}, got {caster:g}"
    rear = robot.rear if caster is None else caster
    if behind is not None and behind >= rear:
        support = f"less than {rear:g}, where the robot is supported"
        yield f"robot.build.mass_behind: expected {support}, got {behind:g}"


def _wrong_motors(robot: Robot) -> Iterator[str]:
    least = least_torque(robot.mass, robot.wheel_radius, robot.limits)
    if robot.wheel_torque < least:
        fastest = max(robot.limits.a, robot.limits.brake)
        needed = f"at least {least:g}, which {robot.mass:g} kg need for {fastest:g} m/s^2"
        yield f"robot.wheel_torque: expected {needed}, got {robot.wheel_torque:g}"


def least_torque(mass: float, wheel_radius: float, limits: Limits) -> float:
    """Return the torque in N m of each of two wheels with which a mass (kg) reaches the limits: F = m a."""
    return _rounded_up(0.5 * mass * max(limits.a, limits.brake) * wheel_radius)


def _wrong_holder(robot: Robot) -> Iterator[str]:
    holder = robot.holder
    if holder is None:
        return
    least, most = holder.held_width, _LOOSE * holder.held_width
    if holder.gap < least:
        expected = f"at least {_rounded_up(least):g}, the width of what is held"
        yield f"robot.holder.gap: expected {expected}, got {holder.gap:g}"
    elif holder.gap > most:
        expected = f"at most {math.floor(1e4 * most) / 1e4:g}, beyond which fingers hold nothing"
        yield f"robot.holder.gap: expected {expected}, got {holder.gap:g}"


def held_by_none(robot: Robot) -> str | None:
    """Return that no object of the scene has the size that the holder is for; None if one has.

    A description says both. The scene of a domain may have other objects, which nobody holds.
    """
    holder, objects = robot.holder, robot.scene.objects
    if holder is None or not objects:
        return None
    if any(abs(each.radius - holder.radius) <= _SAME_RADIUS * holder.radius for each in objects.values()):
        return None
    radii = ", ".join(f"{name} {each.radius:g}" for name, each in objects.items())
    return f"robot.holder.radius: expected that of an object of the scene ({radii}), got {holder.radius:g}"


def _rounded_up(value: float) -> float:
    """Return `value` to four digits after the point, none less: what is asked for is accepted then."""
    return math.ceil(1e4 * value) / 1e4
