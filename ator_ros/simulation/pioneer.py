"""The simulated Pioneer with ball and field: a class without ROS, many worlds in one process."""

from __future__ import annotations

import math
from types import TracebackType

import pybullet as p

from ator_ros.geometry import Pose, quaternion_from_yaw, yaw_from_quaternion
from ator_ros.robot.description import Robot
from ator_ros.simulation.base_controller import BaseController
from ator_ros.simulation.bodies import (
    GRAVITY,
    load_pioneer,
    make_ball,
    make_floor,
    make_goals,
    set_ball_dynamics,
)
from ator_ros.simulation.motors import Motors
from ator_ros.world.state import BallState, Command, RobotState, World

PHYSICS_RATE = 240
CONTROL_RATE = 20
TICK = 1.0 / CONTROL_RATE
RAMPS_PER_TICK = 4
# Converged: with the rotors' inertia in the wheels, 50 iterations give the same speeds to 0.2 %.
SOLVER_ITERATIONS = 20
_AWAY = (0.0, 50.0)


class PioneerSimulation:
    """One world: a Pioneer, a ball, a floor and two goals.

    Deterministic: the same placements and commands give bit-identical trajectories.

    Parameters
    ----------
    robot : Robot
        Shape, masses and limits, with ball and field.

    Notes
    -----
    A control tick of 1/20 s is four ramps of three physics steps of 1/240 s: the base ramps its wheel
    speeds within a tick as firmware does, and Bullet takes the three steps in one call.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._client: int = p.connect(p.DIRECT)
        self._build()
        self.place_robot(Pose(0.0, 0.0, 0.0))
        self.remove_ball()

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
        goals = make_goals(client, self.robot.field)
        self._ball = make_ball(client, self.robot.ball)
        self._body, self._wheels = load_pioneer(client, self.robot)
        # Pairs that never touch cost time: the body and the floor, the wheels and all but the floor.
        p.setCollisionFilterPair(self._body, floor, -1, -1, 0, physicsClientId=client)
        for wheel in self._wheels:
            for other in (self._ball, *goals):
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

    def place_ball(self, x: float, y: float, *, vx: float = 0.0, vy: float = 0.0) -> None:
        """Put the ball on the floor at (x, y) m, rolling at (vx, vy) m/s."""
        set_ball_dynamics(self._client, self._ball, self.robot.ball)
        self._move_ball(x, y, vx, vy)
        self._ball_present = True

    def remove_ball(self) -> None:
        """Take the ball off the field."""
        p.changeDynamics(self._ball, -1, mass=0.0, physicsClientId=self._client)
        self._move_ball(*_AWAY, 0.0, 0.0)
        self._ball_present = False

    def _move_ball(self, x: float, y: float, vx: float, vy: float) -> None:
        radius = self.robot.ball.radius
        p.resetBasePositionAndOrientation(
            self._ball, (x, y, radius), (0.0, 0.0, 0.0, 1.0), physicsClientId=self._client
        )
        p.resetBaseVelocity(
            self._ball, (vx, vy, 0.0), (-vy / radius, vx / radius, 0.0), physicsClientId=self._client
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
            self._motors.turn(self._base.ramp(self.time, dt))
            p.stepSimulation(physicsClientId=self._client)
        self._ticks += 1

    def world(self) -> World:
        """Return the true state: time, robot, and the ball unless it was removed."""
        return World(self.time, self._robot_state(), self._ball_state())

    def _robot_state(self) -> RobotState:
        position, quaternion = p.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        linear, angular = p.getBaseVelocity(self._body, physicsClientId=self._client)
        yaw = yaw_from_quaternion(*quaternion)
        c, s = math.cos(yaw), math.sin(yaw)
        pose = Pose(position[0] - c * self._com[0], position[1] - s * self._com[0], yaw)
        return RobotState(pose, c * linear[0] + s * linear[1], angular[2])

    def _ball_state(self) -> BallState | None:
        if not self._ball_present:
            return None
        position, _ = p.getBasePositionAndOrientation(self._ball, physicsClientId=self._client)
        linear, _ = p.getBaseVelocity(self._ball, physicsClientId=self._client)
        return BallState(position[0], position[1], linear[0], linear[1])

    def close(self) -> None:
        """Free the world; it cannot be used afterwards."""
        if self._client >= 0:
            p.disconnect(physicsClientId=self._client)
            self._client = -1

    def __enter__(self) -> PioneerSimulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
