"""One robot's base in a simulated world: its body, firmware and motors."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ator_ros.geometry import Pose, quaternion_from_yaw, yaw_from_quaternion
from ator_ros.robot.description import Robot
from ator_ros.simulation import physics as p
from ator_ros.simulation.base_controller import BaseController
from ator_ros.simulation.bodies import load_base
from ator_ros.simulation.motors import Motors
from ator_ros.world.state import Command, RobotState


class SimulatedBase:
    """A base with two driven wheels on the floor of a pybullet client.

    Parameters
    ----------
    client : int
        Where it is made.
    robot : Robot
        Shape, masses and limits.
    shares : (float, float)
        Speeds of the left and the right wheel as shares of what was commanded.
    period : float
        Time of a physics step in s.

    Attributes
    ----------
    body : int
        Its body id.
    robot : Robot
        As given.
    """

    def __init__(self, client: int, robot: Robot, shares: tuple[float, float], *, period: float) -> None:
        self._client, self.robot, self._shares = client, robot, shares
        self.body, self._wheels = load_base(client, robot)
        self._controller = BaseController(robot)
        self._motors = Motors(client, self.body, self._wheels, robot, period=period)
        self._com = p.getDynamicsInfo(self.body, -1, physicsClientId=client)[3]

    def ignore(self, floor: int, others: Iterable[int]) -> None:
        """Leave out pairs of bodies that never touch, which cost time.

        They are the body with the floor, and the wheels with all but the floor.
        """
        client = self._client
        p.setCollisionFilterPair(self.body, floor, -1, -1, 0, physicsClientId=client)
        links = {other: p.getNumJoints(other, physicsClientId=client) for other in others}
        for wheel in self._wheels:
            for other, count in links.items():
                for link in range(-1, count):
                    p.setCollisionFilterPair(self.body, other, wheel, link, 0, physicsClientId=client)

    def place(self, pose: Pose, v: float, w: float) -> None:
        """Put the axle at `pose`, moving at v (m/s) and w (rad/s)."""
        client, c, s = self._client, math.cos(pose.yaw), math.sin(pose.yaw)
        velocity = (c * v - s * w * self._com[0], s * v + c * w * self._com[0], 0.0)
        self.move(pose)
        p.resetBaseVelocity(self.body, velocity, (0.0, 0.0, w), physicsClientId=client)
        turn = w * self.robot.track / 2.0
        for wheel, speed in zip(self._wheels, (v - turn, v + turn), strict=True):
            p.resetJointState(self.body, wheel, 0.0, speed / self.robot.wheel_radius, physicsClientId=client)
        self._controller.reset(Command(v, w))
        self._motors.release()

    def move(self, pose: Pose) -> None:
        """Put the axle at `pose`; wheels, motors and firmware stay as they are."""
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        # Bullet's base position is the centre of mass, not the axle.
        position = (pose.x + c * self._com[0], pose.y + s * self._com[0], self._com[2])
        p.resetBasePositionAndOrientation(
            self.body, position, quaternion_from_yaw(pose.yaw), physicsClientId=self._client
        )

    def command(self, command: Command, time: float) -> None:
        """Accept a command at `time` (s); raises ValueError if it is not finite."""
        self._controller.command(command, time)

    def ramp(self, time: float, dt: float) -> None:
        """Set the motors for the next `dt` s."""
        left, right = self._controller.ramp(time, dt)
        self._motors.turn((left * self._shares[0], right * self._shares[1]))

    def state(self) -> RobotState:
        """Return the true state."""
        position, quaternion = p.getBasePositionAndOrientation(self.body, physicsClientId=self._client)
        linear, angular = p.getBaseVelocity(self.body, physicsClientId=self._client)
        yaw = yaw_from_quaternion(*quaternion)
        c, s = math.cos(yaw), math.sin(yaw)
        pose = Pose(position[0] - c * self._com[0], position[1] - s * self._com[0], yaw)
        return RobotState(pose, c * linear[0] + s * linear[1], angular[2])
