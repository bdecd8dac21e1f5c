"""The bodies of the simulated world: floor, bays, objects and robot, made in one pybullet client."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

from ator_ros.geometry import quaternion_from_yaw
from ator_ros.robot.description import Robot
from ator_ros.simulation import physics as p
from ator_ros.simulation.urdf import WHEEL_NAMES, robot_urdf
from ator_ros.world.scene import WALL_THICKNESS, Bay, RoundObject

GRAVITY = 9.81
WALL_HEIGHT = 0.4


def make_floor(client: int) -> int:
    """Make the plane z = 0 and return its body id."""
    shape = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
    floor = p.createMultiBody(0, shape, physicsClientId=client)
    p.changeDynamics(floor, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
    return int(floor)


def make_bay(client: int, bay: Bay) -> list[int]:
    """Make the three walls of a bay and return their body ids."""
    half_depth, half_width = bay.depth / 2, bay.width / 2
    side = _box(client, half_depth, WALL_THICKNESS / 2)
    back = _box(client, WALL_THICKNESS / 2, half_width)
    # Rounded, so that what faces along an axis lies exactly along it.
    c, s = round(math.cos(bay.yaw), 12), round(math.sin(bay.yaw), 12)
    turned = math.atan2(s, c) % math.pi  # a box that is turned by half a turn is the same box
    beside = half_width + WALL_THICKNESS / 2
    left, right = (beside, -beside) if c >= 0.0 else (-beside, beside)
    walls = []
    for shape, ahead, aside in (
        (side, half_depth, left),
        (side, half_depth, right),
        (back, bay.depth + WALL_THICKNESS / 2, 0.0),
    ):
        place = [bay.x + c * ahead - s * aside, bay.y + s * ahead + c * aside, WALL_HEIGHT / 2]
        walls.append(
            int(p.createMultiBody(0, shape, -1, place, quaternion_from_yaw(turned), physicsClientId=client))
        )
    return walls


def _box(client: int, half_length: float, half_width: float) -> int:
    halves = [half_length, half_width, WALL_HEIGHT / 2]
    return int(p.createCollisionShape(p.GEOM_BOX, halfExtents=halves, physicsClientId=client))


def make_object(client: int, item: RoundObject) -> int:
    """Make an object's body and return its id."""
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=item.radius, physicsClientId=client)
    return int(p.createMultiBody(item.mass, shape, physicsClientId=client))


def set_object_dynamics(client: int, body: int, item: RoundObject) -> None:
    """Set an object's mass and friction: a hollow sphere that decelerates as it rolls."""
    inertia = 2.0 / 3.0 * item.mass * item.radius**2
    # A rolling hollow sphere resists with (1 + 2/3) m a r; Bullet: coefficient times normal force.
    rolling = 5.0 / 3.0 * item.radius * item.rolling_deceleration / GRAVITY
    p.changeDynamics(body, -1, mass=item.mass, physicsClientId=client)  # which resets the inertia
    p.changeDynamics(
        body,
        -1,
        localInertiaDiagonal=[inertia] * 3,
        lateralFriction=1.0,
        rollingFriction=rolling,
        spinningFriction=0.001,
        restitution=item.restitution,
        linearDamping=0.0,
        angularDamping=0.0,
        physicsClientId=client,
    )


def load_base(client: int, robot: Robot) -> tuple[int, list[int]]:
    """Load the robot and return its body id and the joint indices of its left and right wheel."""
    with tempfile.TemporaryDirectory(prefix="ator_ros_") as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(robot_urdf(robot), encoding="utf-8")
        body = p.loadURDF(str(file), flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    count = p.getNumJoints(body, physicsClientId=client)
    names = {p.getJointInfo(body, joint, physicsClientId=client)[1].decode(): joint for joint in range(count)}
    wheels = [names[name] for name in WHEEL_NAMES]
    wheel_friction, caster_friction = 1.0, 0.0
    front = robot.build.front_friction
    p.changeDynamics(body, -1, lateralFriction=front, restitution=1.0, physicsClientId=client)
    for wheel in wheels:
        p.changeDynamics(
            body, wheel, lateralFriction=wheel_friction, rollingFriction=0.0, restitution=0.0,
            linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client,
        )  # fmt: skip
    caster = names["caster_joint"]
    p.changeDynamics(body, caster, lateralFriction=caster_friction, restitution=0.0, physicsClientId=client)
    return int(body), wheels
