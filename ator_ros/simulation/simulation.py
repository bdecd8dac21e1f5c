"""A simulated robot in its scene: a class without ROS, many worlds in one process."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import TracebackType

import pybullet as p

from ator_ros.geometry import Pose, quaternion_from_yaw, yaw_from_quaternion
from ator_ros.robot.description import Robot
from ator_ros.simulation.base_controller import BaseController
from ator_ros.simulation.bodies import (
    GRAVITY,
    load_base,
    make_bay,
    make_floor,
    make_object,
    set_object_dynamics,
)
from ator_ros.simulation.motors import Motors
from ator_ros.world.state import CONTROL_PERIOD, Command, ObjectState, RobotState, World

PHYSICS_RATE = 240
TICK = CONTROL_PERIOD
CONTROL_RATE = round(1.0 / TICK)
RAMPS_PER_TICK = 4
# Converged: with the rotors' inertia in the wheels, 50 iterations give the same speeds to 0.2 %.
SOLVER_ITERATIONS = 20
_AWAY = 50.0


class Simulation:
    """One world: a robot, the objects and bays of its scene, and a floor.

    Deterministic: the same placements and commands give bit-identical trajectories.

    Parameters
    ----------
    robot : Robot
        Shape, masses and limits, with its scene.
    wheels : (float, float)
        Speeds of the left and the right wheel as shares of what was commanded: below 1 a wheel slips.

    Notes
    -----
    A control tick of 1/20 s is four ramps of three physics steps of 1/240 s: the base ramps its wheel
    speeds within a tick as firmware does, and Bullet takes the three steps in one call.
    """

    def __init__(self, robot: Robot, *, wheels: tuple[float, float] = (1.0, 1.0)) -> None:
        self.robot = robot
        self._shares = wheels
        self._client: int = p.connect(p.DIRECT)
        self._build()
        self.place_robot(Pose(0.0, 0.0, 0.0))
        for name in self._bodies:
            self.remove_object(name)

    def _build(self) -> None:
        client = self._client
        p.setGravity(0, 0, -GRAVITY, physicsClientId=client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=TICK / RAMPS_PER_TICK,
            numSubSteps=PHYSICS_RATE // (CONTROL_RATE * RAMPS_PER_TICK),
            numSolverIterations=SOLVER_ITERATIONS,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        floor = make_floor(client)
        scene = self.robot.scene
        walls = [wall for bay in scene.bays for wall in make_bay(client, bay)]
        self._bodies = {name: make_object(client, item) for name, item in scene.objects.items()}
        self._present: dict[str, bool] = {}
        self._body, self._wheels = load_base(client, self.robot)
        # Pairs that never touch cost time: the body and the floor, the wheels and all but the floor.
        p.setCollisionFilterPair(self._body, floor, -1, -1, 0, physicsClientId=client)
        for wheel in self._wheels:
            for other in (*self._bodies.values(), *walls):
                p.setCollisionFilterPair(self._body, other, wheel, -1, 0, physicsClientId=client)
        self._com = p.getDynamicsInfo(self._body, -1, physicsClientId=client)[3]
        self._base = BaseController(self.robot)
        self._ticks = 0
        self._motors = Motors(client, self._body, self._wheels, self.robot, period=1.0 / PHYSICS_RATE)

    @property
    def time(self) -> float:
        """Simulated time in s since the world was made."""
        return self._ticks * TICK

    def place_robot(self, pose: Pose, *, v: float = 0.0, w: float = 0.0) -> None:
        """Put the robot's axle at `pose`, moving at v (m/s) and w (rad/s)."""
        client, c, s = self._client, math.cos(pose.yaw), math.sin(pose.yaw)
        # Bullet's base position is the centre of mass, not the axle.
        position = (pose.x + c * self._com[0], pose.y + s * self._com[0], self._com[2])
        velocity = (c * v - s * w * self._com[0], s * v + c * w * self._com[0], 0.0)
        p.resetBasePositionAndOrientation(
            self._body, position, quaternion_from_yaw(pose.yaw), physicsClientId=client
        )
        p.resetBaseVelocity(self._body, velocity, (0.0, 0.0, w), physicsClientId=client)
        turn = w * self.robot.track / 2.0
        for wheel, speed in zip(self._wheels, (v - turn, v + turn), strict=True):
            p.resetJointState(self._body, wheel, 0.0, speed / self.robot.wheel_radius, physicsClientId=client)
        self._base.reset(Command(v, w))
        self._motors.release()

    def place_object(self, name: str, x: float, y: float, *, vx: float = 0.0, vy: float = 0.0) -> None:
        """Put an object on the floor at (x, y) m, rolling at (vx, vy) m/s.

        Raises
        ------
        ValueError
            The scene has no such object.
        """
        set_object_dynamics(self._client, self._body_of(name), self.robot.scene.objects[name])
        self._move_object(name, x, y, vx, vy)
        self._present[name] = True

    def remove_object(self, name: str) -> None:
        """Take an object off the floor; raises ValueError if the scene has no such object."""
        p.changeDynamics(self._body_of(name), -1, mass=0.0, physicsClientId=self._client)
        self._move_object(name, 0.0, _AWAY + list(self._bodies).index(name), 0.0, 0.0)
        self._present[name] = False

    def place_objects(self, objects: Mapping[str, ObjectState]) -> None:
        """Place these objects and take all others off the floor; raises ValueError if one is unknown."""
        for name, there in objects.items():
            self.place_object(name, there.x, there.y, vx=there.vx, vy=there.vy)
        for name in self._bodies:
            if name not in objects:
                self.remove_object(name)

    def _body_of(self, name: str) -> int:
        if name not in self._bodies:
            raise ValueError(f"object: expected one of the scene, {sorted(self._bodies)}, got {name!r}")
        return self._bodies[name]

    def _move_object(self, name: str, x: float, y: float, vx: float, vy: float) -> None:
        body, radius = self._bodies[name], self.robot.scene.objects[name].radius
        p.resetBasePositionAndOrientation(
            body, (x, y, radius), (0.0, 0.0, 0.0, 1.0), physicsClientId=self._client
        )
        p.resetBaseVelocity(
            body, (vx, vy, 0.0), (-vy / radius, vx / radius, 0.0), physicsClientId=self._client
        )

    def command(self, command: Command) -> None:
        """Send the base a velocity command; it holds for 0.15 s and is clipped to the limits.

        Raises
        ------
        ValueError
            The command is not finite.
        """
        self._base.command(command, self.time)

    def tick(self) -> None:
        """Advance the world by one control tick of 1/20 s."""
        dt = TICK / RAMPS_PER_TICK
        for _ in range(RAMPS_PER_TICK):
            left, right = self._base.ramp(self.time, dt)
            self._motors.turn((left * self._shares[0], right * self._shares[1]))
            p.stepSimulation(physicsClientId=self._client)
        self._ticks += 1

    def world(self) -> World:
        """Return the true state: time, robot, and the objects that are there."""
        objects = {
            name: self._object_state(body) for name, body in self._bodies.items() if self._present[name]
        }
        return World(self.time, self._robot_state(), objects)

    def _robot_state(self) -> RobotState:
        position, quaternion = p.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        linear, angular = p.getBaseVelocity(self._body, physicsClientId=self._client)
        yaw = yaw_from_quaternion(*quaternion)
        c, s = math.cos(yaw), math.sin(yaw)
        pose = Pose(position[0] - c * self._com[0], position[1] - s * self._com[0], yaw)
        return RobotState(pose, c * linear[0] + s * linear[1], angular[2])

    def _object_state(self, body: int) -> ObjectState:
        position, _ = p.getBasePositionAndOrientation(body, physicsClientId=self._client)
        linear, _ = p.getBaseVelocity(body, physicsClientId=self._client)
        return ObjectState(position[0], position[1], linear[0], linear[1])

    def close(self) -> None:
        """Free the world; it cannot be used afterwards."""
        if self._client >= 0:
            p.disconnect(physicsClientId=self._client)
            self._client = -1

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
