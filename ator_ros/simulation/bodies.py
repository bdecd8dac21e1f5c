"""The bodies of the simulated world: floor, goals, ball and Pioneer, made in one pybullet client."""

from __future__ import annotations

import tempfile
from pathlib import Path
from string import Template

import pybullet as p

from ator_ros.resources import resource_path
from ator_ros.robot.description import Ball, Robot
from ator_ros.world.state import Field

GRAVITY = 9.81
WHEEL_MASS = 0.4
# Seen through the gear (38.3:1) the motor's rotor outweighs the wheel: 4e-6 kg m^2 * 38.3^2.
WHEEL_INERTIA = 0.008
CENTRE_OF_MASS_X = -0.06
WALL_THICKNESS = 0.05
WALL_HEIGHT = 0.4
WHEEL_NAMES = ("left_wheel_joint", "right_wheel_joint")


def robot_urdf(robot: Robot) -> str:
    """Return the robot's description as URDF, for pybullet and for RViz.

    Parameters
    ----------
    robot : Robot
        Sizes and masses; everything else is in `urdf/pioneer.urdf.template`.
    """
    body_mass = robot.mass - 2 * WHEEL_MASS
    length, width = robot.front + robot.rear, 2 * robot.half_width - 0.08
    numbers = {
        "com_x": CENTRE_OF_MASS_X,
        "body_mass": body_mass,
        "ixx": body_mass * (width**2 + 0.2**2) / 12,
        "iyy": body_mass * (length**2 + 0.2**2) / 12,
        "izz": body_mass * (length**2 + width**2) / 12,
        "body_x": (robot.front - robot.rear) / 2,
        "body_length": length,
        "body_width": width,
        "fin_x": robot.front + robot.fin_length / 2,
        "fin_y": (robot.fin_gap + robot.fin_thickness) / 2,
        "fin_length": robot.fin_length,
        "fin_thickness": robot.fin_thickness,
        "wheel_mass": WHEEL_MASS,
        "wheel_i": WHEEL_INERTIA,
        "wheel_radius": robot.wheel_radius,
        "half_track": robot.track / 2,
        "caster_x": -robot.rear + 0.04,
    }
    template = Template(resource_path("urdf", "pioneer.urdf.template").read_text(encoding="utf-8"))
    return template.substitute({name: f"{value:.6g}" for name, value in numbers.items()})


def make_floor(client: int) -> int:
    """Make the plane z = 0 and give its body id."""
    shape = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
    floor = p.createMultiBody(0, shape, physicsClientId=client)
    p.changeDynamics(floor, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
    return int(floor)


def make_goals(client: int, field: Field) -> list[int]:
    """Make two goals of three walls each behind the goal lines and give their body ids."""
    walls = []
    half_depth, half_width = field.goal_depth / 2, field.goal_width / 2
    side = p.createCollisionShape(
        p.GEOM_BOX, halfExtents=[half_depth, WALL_THICKNESS / 2, WALL_HEIGHT / 2], physicsClientId=client
    )
    back = p.createCollisionShape(
        p.GEOM_BOX, halfExtents=[WALL_THICKNESS / 2, half_width, WALL_HEIGHT / 2], physicsClientId=client
    )
    for sign in (-1, 1):
        x, _ = field.goal_centre(sign)
        middle = x + sign * half_depth
        y = half_width + WALL_THICKNESS / 2
        for shape, position in (
            (side, (middle, y)),
            (side, (middle, -y)),
            (back, (x + sign * (field.goal_depth + WALL_THICKNESS / 2), 0.0)),
        ):
            place = [*position, WALL_HEIGHT / 2]
            walls.append(int(p.createMultiBody(0, shape, basePosition=place, physicsClientId=client)))
    return walls


def make_ball(client: int, ball: Ball) -> int:
    """Make the ball's body and give its id."""
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=ball.radius, physicsClientId=client)
    return int(p.createMultiBody(ball.mass, shape, physicsClientId=client))


def set_ball_dynamics(client: int, body: int, ball: Ball) -> None:
    """Set the ball's mass and friction: a hollow sphere that decelerates as it rolls."""
    inertia = 2.0 / 3.0 * ball.mass * ball.radius**2
    # A rolling hollow ball resists with (1 + 2/3) m a r; Bullet: coefficient times normal force.
    rolling = 5.0 / 3.0 * ball.radius * ball.rolling_deceleration / GRAVITY
    p.changeDynamics(body, -1, mass=ball.mass, physicsClientId=client)  # which resets the inertia
    p.changeDynamics(
        body,
        -1,
        localInertiaDiagonal=[inertia] * 3,
        lateralFriction=1.0,
        rollingFriction=rolling,
        spinningFriction=0.001,
        restitution=ball.restitution,
        linearDamping=0.0,
        angularDamping=0.0,
        physicsClientId=client,
    )


def load_pioneer(client: int, robot: Robot) -> tuple[int, list[int]]:
    """Load the robot and give its body id and the joint indices of its left and right wheel."""
    with tempfile.TemporaryDirectory(prefix="ator_ros_") as folder:
        file = Path(folder) / "pioneer.urdf"
        file.write_text(robot_urdf(robot), encoding="utf-8")
        body = p.loadURDF(str(file), flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    count = p.getNumJoints(body, physicsClientId=client)
    names = {p.getJointInfo(body, joint, physicsClientId=client)[1].decode(): joint for joint in range(count)}
    wheels = [names[name] for name in WHEEL_NAMES]
    body_friction, wheel_friction, caster_friction = 0.15, 1.0, 0.0
    p.changeDynamics(body, -1, lateralFriction=body_friction, restitution=1.0, physicsClientId=client)
    for wheel in wheels:
        p.changeDynamics(
            body, wheel, lateralFriction=wheel_friction, rollingFriction=0.0, restitution=0.0,
            linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client,
        )  # fmt: skip
    caster = names["caster_joint"]
    p.changeDynamics(body, caster, lateralFriction=caster_friction, restitution=0.0, physicsClientId=client)
    return int(body), wheels
