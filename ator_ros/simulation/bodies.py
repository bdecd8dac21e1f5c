"""The bodies of the simulated world: floor, bays, walls, objects and robot.

All are made in one pybullet client. pybullet is imported when the first world is made: ``--help``
and most nodes do not need it.
"""

from __future__ import annotations

import functools
import importlib
import math
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from ator_ros.bases.description import Robot
from ator_ros.bases.differential.robot import DifferentialRobot
from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.geometry import quaternion_from_yaw
from ator_ros.simulation.urdf import WHEEL_NAMES, robot_urdf
from ator_ros.world.grid_map import GridMap
from ator_ros.world.scene import WALL_THICKNESS, Area, Bay, RoundObject

GRAVITY = 9.81  # m/s^2
WALL_HEIGHT = 0.4  # m


class BulletClient:
    """A new world, with the functions and constants of pybullet.

    Each instance is a world of its own. Functions are called without a client id.
    """

    def __init__(self) -> None:
        self._pybullet = _imported_without_banner("pybullet")
        self._number = self._pybullet.connect(self._pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._pybullet, name)
        if callable(found):
            found = functools.partial(found, physicsClientId=self._number)
        setattr(self, name, found)
        return found


def _imported_without_banner(module: str) -> Any:
    """Import a module without what it prints on stderr."""
    try:
        kept = os.dup(2)
    except OSError:  # a process without stderr
        return importlib.import_module(module)
    if sys.stderr is not None:
        sys.stderr.flush()
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        return importlib.import_module(module)
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def make_floor(client: BulletClient) -> int:
    """Make the plane z = 0 and return its body id."""
    shape = client.createCollisionShape(client.GEOM_PLANE)
    floor = client.createMultiBody(0, shape)
    client.changeDynamics(floor, -1, lateralFriction=1.0, restitution=0.0)
    return int(floor)


def make_bay(client: BulletClient, bay: Bay) -> list[int]:
    """Make the three walls of a bay and return their body ids.

    The pose of the bay is relative to the origin of the world.
    """
    half_depth = bay.depth / 2
    half_width = bay.width / 2
    side = _box(client, half_depth, WALL_THICKNESS / 2)
    back = _box(client, WALL_THICKNESS / 2, half_width)
    # Rounded, so that a bay that faces along an axis lies exactly along it.
    c = round(math.cos(bay.yaw), 12)
    s = round(math.sin(bay.yaw), 12)
    turned = math.atan2(s, c) % math.pi  # a box that is turned by half a turn is the same box
    beside = half_width + WALL_THICKNESS / 2
    left, right = (beside, -beside) if c >= 0.0 else (-beside, beside)
    behind = bay.depth + WALL_THICKNESS / 2
    walls = []
    for shape, ahead, aside in (
        (side, half_depth, left),
        (side, half_depth, right),
        (back, behind, 0.0),
    ):
        place = [bay.x + c * ahead - s * aside, bay.y + s * ahead + c * aside, WALL_HEIGHT / 2]
        walls.append(int(client.createMultiBody(0, shape, -1, place, quaternion_from_yaw(turned))))
    return walls


def make_walls(client: BulletClient, grid: GridMap, area: Area) -> list[int]:
    """Make the walls of a map and return their body ids.

    The center of the area is the origin of the world.
    """
    bodies = []
    for (x, y, yaw), length, width in grid.walls:
        place = [x - area.x, y - area.y, WALL_HEIGHT / 2]
        shape = _box(client, length / 2, width / 2)
        bodies.append(int(client.createMultiBody(0, shape, -1, place, quaternion_from_yaw(yaw))))
    return bodies


def _box(client: BulletClient, half_length: float, half_width: float) -> int:
    halves = [half_length, half_width, WALL_HEIGHT / 2]
    return int(client.createCollisionShape(client.GEOM_BOX, halfExtents=halves))


def make_object(client: BulletClient, item: RoundObject) -> int:
    """Make a sphere with the radius and mass of an object, and return its body id."""
    shape = client.createCollisionShape(client.GEOM_SPHERE, radius=item.radius)
    return int(client.createMultiBody(item.mass, shape))


def set_object_dynamics(client: BulletClient, body: int, item: RoundObject) -> None:
    """Set an object's mass and friction: a hollow sphere that decelerates as it rolls."""
    inertia = 2.0 / 3.0 * item.mass * item.radius**2
    # A rolling hollow sphere resists with (1 + 2/3) m a r; Bullet: coefficient times normal force.
    rolling = 5.0 / 3.0 * item.radius * item.rolling_deceleration / GRAVITY
    client.changeDynamics(body, -1, mass=item.mass)  # which resets the inertia
    client.changeDynamics(
        body,
        -1,
        localInertiaDiagonal=[inertia] * 3,
        lateralFriction=1.0,
        rollingFriction=rolling,
        spinningFriction=0.001,
        restitution=item.restitution,
        linearDamping=0.0,
        angularDamping=0.0,
    )


def load_base(client: BulletClient, robot: DifferentialRobot) -> tuple[int, list[int]]:
    """Load a robot with two driven wheels.

    Returns
    -------
    body : int
        Body id.
    wheels : list of int
        Joint indices of the left and the right wheel.
    """
    body, names = _load(client, robot)
    wheels = [names[name] for name in WHEEL_NAMES]
    client.changeDynamics(body, -1, lateralFriction=robot.build.front_friction, restitution=1.0)
    for wheel in wheels:
        client.changeDynamics(
            body,
            wheel,
            lateralFriction=1.0,
            rollingFriction=0.0,
            restitution=0.0,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
        )
    client.changeDynamics(body, names["caster_joint"], lateralFriction=0.0, restitution=0.0)
    return body, wheels


def load_omni_base(client: BulletClient, robot: OmniRobot) -> tuple[int, list[int]]:
    """Load an omnidirectional robot; return its body id, and the joint indices of its feet."""
    body, names = _load(client, robot)
    client.changeDynamics(
        body,
        -1,
        lateralFriction=robot.front_friction,
        restitution=1.0,
        linearDamping=0.0,
        angularDamping=0.0,
    )
    feet = list(names.values())
    for foot in feet:
        client.changeDynamics(body, foot, lateralFriction=0.0, restitution=0.0)
    return body, feet


def _load(client: BulletClient, robot: Robot) -> tuple[int, dict[str, int]]:
    """Load the URDF of a robot; return its body id, and its joint indices by name."""
    with tempfile.TemporaryDirectory(prefix="ator_ros_") as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(robot_urdf(robot), encoding="utf-8")
        body = client.loadURDF(str(file), flags=client.URDF_USE_INERTIA_FROM_FILE)
    count = client.getNumJoints(body)
    names = {client.getJointInfo(body, joint)[1].decode(): joint for joint in range(count)}
    return int(body), names
