"""The robot's description as URDF, for pybullet and for RViz."""

from __future__ import annotations

from string import Template

from ator_ros.bases.description import Holder, Robot
from ator_ros.bases.differential.robot import DifferentialRobot, differential
from ator_ros.resources import resource_path

WHEEL_MASS = 0.4
"""Mass in kg of a wheel; at most `WHEEL_SHARE` of the mass of a light robot."""
WHEEL_SHARE = 0.25
# kg m^2: that of the motor's rotor through the gear (38.3:1), 4e-6 kg m^2 * 38.3^2, exceeds the
# wheel's own.
WHEEL_INERTIA = 0.008
_HEIGHT = 0.12  # m of the center of mass
# ratio of mass times squared radius to the usual one, below which the motors are smaller
_LIGHT = 0.1
# those of the Pioneer 3-DX
_USUAL_MASS = 9.0  # kg
_USUAL_RADIUS = 0.0975  # m, of a wheel
_CENTER_OF_MASS = 0.06  # m behind the axle
_CASTER = 0.04  # m from the body's end
# greatest share of the weight on the caster; `Robot.grip` assumes the rest on the wheels
_BEHIND_SHARE = 0.3
_FINGER = (
    '<{tag}><origin xyz="{x:.6g} {side}{y:.6g} 0.12"/>'
    '<geometry><box size="{length:.6g} {thickness:.6g} 0.1"/></geometry>{material}</{tag}>'
)


def robot_urdf(robot: Robot) -> str:
    """Return the robot's description as URDF.

    It is `urdf/robot.urdf.template` with the robot's sizes in m and masses in kg.
    """
    robot = differential(robot)
    behind, height, caster, wheel_mass, wheel_inertia = _built(robot)
    body_mass = robot.mass - 2 * wheel_mass
    # The body lies between the wheels; that of a robot narrower than 16 cm overlaps them.
    length = robot.front + robot.rear
    width = max(2 * robot.half_width - 0.08, robot.half_width)
    numbers = {
        "com_x": -behind,
        "com_z": height,
        "body_mass": body_mass,
        "ixx": body_mass * (width**2 + 0.2**2) / 12,
        "iyy": body_mass * (length**2 + 0.2**2) / 12,
        "izz": body_mass * (length**2 + width**2) / 12,
        "body_x": (robot.front - robot.rear) / 2,
        "body_length": length,
        "body_width": width,
        "wheel_mass": wheel_mass,
        "wheel_i": wheel_inertia,
        "wheel_radius": robot.wheel_radius,
        "half_track": robot.track / 2,
        "caster_x": -caster,
    }
    fingers = {
        "visual_fingers": _fingers("visual", robot.holder, robot.front, '<material name="steel"/>'),
        "collision_fingers": _fingers("collision", robot.holder, robot.front),
    }
    template = Template(resource_path("urdf", "robot.urdf.template").read_text(encoding="utf-8"))
    return template.substitute({name: f"{value:.6g}" for name, value in numbers.items()} | fingers)


def _built(robot: DifferentialRobot) -> tuple[float, float, float, float, float]:
    """Return the parts of `Build` in their order, those that the description leaves out derived."""
    given = robot.build
    usual = WHEEL_MASS * max(1.0, robot.mass / _USUAL_MASS)
    wheel_mass = min(usual, WHEEL_SHARE * robot.mass)
    # The wheels carry most of the weight also of a short body, so low that neither stop nor turn
    # tips it.
    caster = _or(given.caster_behind, max(robot.rear - _CASTER, 0.5 * robot.rear))
    behind = min(_CENTER_OF_MASS, _BEHIND_SHARE * caster)
    height = _HEIGHT * (behind / _CENTER_OF_MASS)
    # With the inertia of usual motors a heavy base would lag more than described, and a light one
    # tip over.
    load = robot.mass * robot.wheel_radius**2 / (_USUAL_MASS * _USUAL_RADIUS**2)
    motor_size = max(1.0, load) if load >= _LIGHT else max(load, (load / _LIGHT) ** 2)
    return (
        _or(given.mass_behind, behind),
        _or(given.mass_height, height),
        caster,
        _or(given.wheel_mass, wheel_mass),
        _or(given.wheel_inertia, WHEEL_INERTIA * motor_size),
    )


def _or(given: float | None, derived: float) -> float:
    return derived if given is None else given


def _fingers(
    tag: str,
    holder: Holder | None,
    front: float,
    material: str = "",
) -> str:
    """Return the elements of both fingers of a holder; nothing without one."""
    if holder is None:
        return ""
    numbers = {
        "length": holder.length,
        "thickness": holder.thickness,
        "x": front + holder.length / 2,
        "y": (holder.gap + holder.thickness) / 2,
    }
    left = _FINGER.format(tag=tag, side="", material=material, **numbers)
    right = _FINGER.format(tag=tag, side="-", material=material, **numbers)
    return f"{left}\n    {right}"


WHEEL_NAMES = ("left_wheel_joint", "right_wheel_joint")
"""The joints of the wheels in the URDF."""
