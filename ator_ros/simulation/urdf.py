"""The robot's description as URDF, for pybullet and for RViz."""

from __future__ import annotations

from collections.abc import Mapping
from string import Template

from ator_ros.bases.description import Holder, Robot
from ator_ros.bases.differential.robot import DifferentialRobot, differential
from ator_ros.bases.omni.omni_robot import OmniBase, OmniRobot, omnidirectional
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


_FEET = ("front_left", "front_right", "rear_left", "rear_right")
_FOOT_RADIUS = 0.03  # m
_FOOT = """<link name="{name}_foot">
    <inertial><mass value="{mass:.6g}"/><inertia ixx="{i:.6g}" iyy="{i:.6g}" izz="{i:.6g}" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><sphere radius="{radius:.6g}"/></geometry><material name="black"/></visual>
    <collision><geometry><sphere radius="{radius:.6g}"/></geometry></collision>
  </link>
  <joint name="{name}_foot_joint" type="fixed">
    <parent link="base_link"/><child link="{name}_foot"/>
    <origin xyz="{x:.6g} {y:.6g} {radius:.6g}"/>
  </joint>"""  # noqa: E501
_FOOT_SHARE = 0.001  # of the robot's mass


def robot_urdf(robot: Robot) -> str:
    """Return the robot's description as URDF, with its sizes in m and masses in kg."""
    if isinstance(robot, OmniBase):
        return _omni_urdf(omnidirectional(robot))
    return _differential_urdf(differential(robot))


def _omni_urdf(robot: OmniRobot) -> str:
    """Return `urdf/omni_robot.urdf.template`: a body on four feet, which slide without friction.

    Forces move it, see `ator_ros.simulation.simulated_omni_base`.
    """
    foot_mass = _FOOT_SHARE * robot.mass
    mass = robot.mass - len(_FEET) * foot_mass
    length = robot.front + robot.rear
    width = 2.0 * robot.half_width
    feet = "\n  ".join(
        _FOOT.format(
            name=name,
            mass=foot_mass,
            i=0.4 * foot_mass * _FOOT_RADIUS**2,
            radius=_FOOT_RADIUS,
            x=robot.front - _FOOT_RADIUS if name.startswith("front") else _FOOT_RADIUS - robot.rear,
            y=(1.0 if name.endswith("left") else -1.0) * (robot.half_width - _FOOT_RADIUS),
        )
        for name in _FEET
    )
    numbers = {
        "com_z": _HEIGHT,
        "mass": mass,
        "ixx": mass * (width**2 + 0.2**2) / 12,
        "iyy": mass * (length**2 + 0.2**2) / 12,
        "izz": mass * (length**2 + width**2) / 12,
        "body_x": (robot.front - robot.rear) / 2,
        "body_length": length,
        "body_width": width,
    }
    return _filled("omni_robot.urdf.template", numbers, {"feet": feet, **_holder_elements(robot)})


def _differential_urdf(robot: DifferentialRobot) -> str:
    """Return `urdf/robot.urdf.template`."""
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
    return _filled("robot.urdf.template", numbers, _holder_elements(robot))


def _holder_elements(robot: Robot) -> dict[str, str]:
    return {
        "visual_fingers": _fingers("visual", robot.holder, robot.front, '<material name="steel"/>'),
        "collision_fingers": _fingers("collision", robot.holder, robot.front),
    }


def _filled(name: str, numbers: Mapping[str, float], elements: dict[str, str]) -> str:
    """Return the template of a URDF with numbers and elements."""
    template = Template(resource_path("urdf", name).read_text(encoding="utf-8"))
    return template.substitute({key: f"{value:.6g}" for key, value in numbers.items()} | elements)


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
"""The joints of the wheels in the URDF of a robot with two driven wheels."""


def wheel_names(robot: Robot) -> tuple[str, ...]:
    """Return the joints of the wheels in the URDF; those of an omnidirectional base are left out.

    Its wheels are no part of the simulation.
    """
    return () if isinstance(robot, OmniBase) else WHEEL_NAMES
