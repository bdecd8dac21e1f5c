"""Simulated robots in a scene: a class without ROS, many worlds in one process."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from ator_ros.bases.description import Robot
from ator_ros.bases.differential.robot import differential
from ator_ros.bases.omni.omni_robot import OmniBase, omnidirectional
from ator_ros.geometry import Pose
from ator_ros.simulation.bodies import (
    GRAVITY,
    BulletClient,
    make_bay,
    make_floor,
    make_object,
    make_walls,
    set_object_dynamics,
)
from ator_ros.simulation.simulated_base import SimulatedBase
from ator_ros.simulation.simulated_omni_base import SimulatedOmniBase
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, ObjectState, World

PHYSICS_RATE = 240  # Hz
TICK = CONTROL_PERIOD  # s
CONTROL_RATE = round(1.0 / TICK)  # Hz
RAMPS_PER_TICK = 4  # changes of the wheels' set speeds
# Converged: with the rotors' inertia in the wheels, 50 iterations give the same speeds to 0.2 %.
SOLVER_ITERATIONS = 20
_AWAY = 50.0  # m: least distance of removed bodies from the center of the area
_DEEPEST = 0.005  # m by which placed bodies may overlap: contacts of a run reach about 1 mm
_DISTANCE = 8  # index in what getClosestPoints returns


class Simulation:
    """One world: robots, the objects and bays of a scene, the walls of a map, and a floor.

    Deterministic: the same placements and commands give bit-identical trajectories. Robots have
    numbers from 0 on. Poses are in the frame of the scene.

    Parameters
    ----------
    robot : Robot
        The description of every robot, and the scene.
    robots : int or sequence of Robot
        Number of robots, or the description of each where they differ; the scene is that of
        `robot`. They are far away until they are placed.

    Notes
    -----
    A control tick of 1/20 s is four ramps of three physics steps of 1/240 s: the base ramps its
    wheel speeds within a tick as firmware does, and Bullet takes the three steps in one call.
    """

    def __init__(self, robot: Robot, *, robots: int | Sequence[Robot] = 1) -> None:
        self.robot = robot
        described = [robot] * robots if isinstance(robots, int) else list(robots)
        self._bullet = BulletClient()
        # The origin of the physics is the center of the area: far from it, contacts would be
        # rounded.
        self._area = robot.scene.area
        self._away = max(_AWAY, self._area.width / 2 + self._area.margin + _AWAY / 2)
        self._build(described)
        for number in range(len(described)):
            self.place_robot(self._area.at(0.0, -self._away * number), number=number)
        for name in self._bodies:
            self.remove_object(name)

    def _build(self, robots: Sequence[Robot]) -> None:
        bullet = self._bullet
        bullet.setGravity(0, 0, -GRAVITY)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=TICK / RAMPS_PER_TICK,
            numSubSteps=PHYSICS_RATE // (CONTROL_RATE * RAMPS_PER_TICK),
            numSolverIterations=SOLVER_ITERATIONS,
            deterministicOverlappingPairs=1,
        )
        floor = make_floor(bullet)
        scene = self.robot.scene
        area = self._area
        bays = (dataclasses.replace(bay, x=bay.x - area.x, y=bay.y - area.y) for bay in scene.bays)
        self._walls = [wall for bay in bays for wall in make_bay(bullet, bay)]
        if self.robot.grid is not None:
            self._walls += make_walls(bullet, self.robot.grid, area)
        self._bodies = {name: make_object(bullet, item) for name, item in scene.objects.items()}
        self._present = dict.fromkeys(self._bodies, False)
        self._bases = [_simulated(bullet, robot) for robot in robots]
        for base in self._bases:
            others = [other.body for other in self._bases if other is not base]
            base.ignore(floor, (*self._bodies.values(), *self._walls, *others))
        self._ticks = 0

    @property
    def time(self) -> float:
        """Simulated time in s since the world was made."""
        return self._ticks * TICK

    def place_robot(
        self,
        pose: Pose,
        velocity: Command = STOP,
        *,
        number: int = 0,
    ) -> None:
        """Put a robot's axle at `pose`, moving at `velocity`."""
        self._bases[number].place(self._local(pose), velocity)

    def _local(self, pose: Pose) -> Pose:
        """Return a pose relative to the center of the area."""
        return Pose(
            pose.x - self._area.x,
            pose.y - self._area.y,
            pose.yaw,
        )

    def place_object(
        self,
        name: str,
        x: float,
        y: float,
        *,
        vx: float = 0.0,
        vy: float = 0.0,
    ) -> None:
        """Put an object on the floor at (x, y) m, rolling at (vx, vy) m/s.

        Raises KeyError for a name that the scene lacks.
        """
        set_object_dynamics(
            self._bullet,
            self._bodies[name],
            self.robot.scene.objects[name],
        )
        self._move_object(
            name,
            x - self._area.x,
            y - self._area.y,
            vx,
            vy,
        )
        self._present[name] = True

    def remove_object(self, name: str) -> None:
        """Take an object off the floor."""
        self._bullet.changeDynamics(self._bodies[name], -1, mass=0.0)
        self._move_object(
            name,
            0.0,
            self._away + list(self._bodies).index(name),
            0.0,
            0.0,
        )
        self._present[name] = False

    def robot_overlap(self, pose: Pose, *, number: int = 0) -> str:
        """Return which body a robot at `pose` would overlap; empty if none. Nothing is moved."""
        body = self._bases[number].body
        with self._restored(body):
            self._bases[number].move(self._local(pose))
            return self._overlap(body)

    def object_overlap(self, name: str, x: float, y: float) -> str:
        """Return which body an object at (x, y) m would overlap; empty if none.

        Nothing is moved.
        """
        body = self._bodies[name]
        with self._restored(body):
            self._move_object(
                name,
                x - self._area.x,
                y - self._area.y,
                0.0,
                0.0,
            )
            return self._overlap(body)

    @contextmanager
    def _restored(self, body: int) -> Iterator[None]:
        """Put a body back after the block, with its velocity."""
        place = self._bullet.getBasePositionAndOrientation(body)
        velocity = self._bullet.getBaseVelocity(body)
        try:
            yield
        finally:
            self._bullet.resetBasePositionAndOrientation(body, *place)
            self._bullet.resetBaseVelocity(body, *velocity)

    def _overlap(self, body: int) -> str:
        """Return the name of a body that `body` overlaps; wheels touch nothing but the floor."""
        others: dict[int, str] = {}
        for name, item in self._bodies.items():
            if self._present[name]:
                others[item] = f"the {name}"
        for base in self._bases:
            others[base.body] = f"robot {base.robot.name}"
        others.update(dict.fromkeys(self._walls, "a wall"))
        others.pop(body, None)
        for other, name in others.items():
            contacts = self._bullet.getClosestPoints(body, other, 0.0, -1, -1)
            if any(contact[_DISTANCE] < -_DEEPEST for contact in contacts):
                return name
        return ""

    def place_objects(self, objects: Mapping[str, ObjectState]) -> None:
        """Place these objects and take all others off the floor."""
        for name, state in objects.items():
            self.place_object(
                name,
                state.x,
                state.y,
                vx=state.vx,
                vy=state.vy,
            )
        for name in self._bodies:
            if name not in objects:
                self.remove_object(name)

    def _move_object(
        self,
        name: str,
        x: float,
        y: float,
        vx: float,
        vy: float,
    ) -> None:
        body = self._bodies[name]
        radius = self.robot.scene.objects[name].radius
        self._bullet.resetBasePositionAndOrientation(
            body,
            (x, y, radius),
            (0.0, 0.0, 0.0, 1.0),
        )
        self._bullet.resetBaseVelocity(
            body,
            (vx, vy, 0.0),
            (-vy / radius, vx / radius, 0.0),
        )

    def command(self, command: Command, *, number: int = 0) -> None:
        """Send a robot a velocity command, which holds for 0.15 s and is clipped to the limits."""
        self._bases[number].command(command, self.time)

    def commanded(self, *, number: int = 0) -> Command | None:
        """Return the command that a robot executes now; None without one."""
        return self._bases[number].commanded(self.time)

    def tick(self) -> None:
        """Advance the world by one control tick of 1/20 s."""
        for _ in range(RAMPS_PER_TICK):
            for base in self._bases:
                base.ramp(self.time, TICK / RAMPS_PER_TICK)
            self._bullet.stepSimulation()
        self._ticks += 1

    def world(self, *, number: int = 0) -> World:
        """Return the true state: time, a robot, and the objects on the floor."""
        objects = {}
        for name, body in self._bodies.items():
            if self._present[name]:
                (x, y, _), _ = self._bullet.getBasePositionAndOrientation(body)
                (vx, vy, _), _ = self._bullet.getBaseVelocity(body)
                objects[name] = ObjectState(
                    *self._area.at(x, y)[:2],
                    vx,
                    vy,
                )
        state = self._bases[number].state()
        in_scene = dataclasses.replace(state, pose=self._area.at(*state.pose))
        return World(self.time, in_scene, objects)

    def wheel_angles(self, number: int = 0) -> list[float]:
        """Return the angles of a robot's left and right wheel in rad."""
        return self._bases[number].wheel_angles()

    def close(self) -> None:
        """Free the world; it cannot be used afterwards."""
        self._bullet.disconnect()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _simulated(client: BulletClient, robot: Robot) -> SimulatedBase | SimulatedOmniBase:
    """Return the base of a robot in a world; raise ConfigError if it cannot be simulated."""
    if isinstance(robot, OmniBase):
        return SimulatedOmniBase(client, omnidirectional(robot))
    return SimulatedBase(client, differential(robot), period=1.0 / PHYSICS_RATE)
