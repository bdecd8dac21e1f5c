"""One robot's base in a simulated world: its body, its firmware, and the motors of its wheels."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ator_ros.bases.differential.response import ramped
from ator_ros.bases.differential.robot import DifferentialRobot
from ator_ros.geometry import Pose, clip, quaternion_from_yaw, yaw_from_quaternion
from ator_ros.simulation.bodies import BulletClient, load_base
from ator_ros.world.state import STOP, Command, RobotState

COMMAND_TIMEOUT = 0.15
"""Time in s that a command holds: three ticks."""
_ROUNDING = 1e-6  # s
# rad/s; the firmware holds the position of a wheel below this whose setpoint is 0
_BLOCKED_BELOW = 0.05
_HOLDING_GAIN = 0.1  # positionGains of Bullet's joint motors


class HeldCommand:
    """The command of a base, and until when it holds."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the command."""
        self._command = STOP
        self._expires = -math.inf

    def command(self, command: Command, time: float) -> None:
        """Execute a command for 0.15 s from `time` (s) on."""
        self._command = command
        self._expires = time + COMMAND_TIMEOUT - _ROUNDING

    def commanded(self, time: float) -> Command | None:
        """Return the command that the base executes at `time` (s); None without one."""
        return self._command if time < self._expires else None


class SimulatedBase:
    """A base with two driven wheels, and its firmware.

    The firmware converts velocity commands to wheel speeds. For the command 0, and without a
    command for 0.15 s, it brakes as hard as it can without tipping. So the base stands 0.5 s after
    the last command.

    Parameters
    ----------
    client : BulletClient
        The world.
    robot : DifferentialRobot
        The description.
    period : float
        Time of a physics step in s.

    Attributes
    ----------
    body : int
        Body id.
    """

    def __init__(
        self,
        client: BulletClient,
        robot: DifferentialRobot,
        *,
        period: float,
    ) -> None:
        self._bullet = client
        self.robot = robot
        self.body, self._wheels = load_base(client, robot)
        self._com = self._bullet.getDynamicsInfo(self.body, -1)[3]
        self._held_command = HeldCommand()
        self._setpoint = STOP
        self._torques = [robot.wheel_torque] * 2
        self._gains = [period / robot.motor_time_constant] * 2
        self._held: list[float] | None = None

    def ignore(self, floor: int, others: Iterable[int]) -> None:
        """Leave out pairs that never touch.

        These are the robot's body with the floor, and its wheels with all other bodies.
        """
        self._bullet.setCollisionFilterPair(self.body, floor, -1, -1, 0)
        links = {other: self._bullet.getNumJoints(other) for other in others}
        for wheel in self._wheels:
            for other, count in links.items():
                for link in range(-1, count):
                    self._bullet.setCollisionFilterPair(self.body, other, wheel, link, 0)

    def place(self, pose: Pose, moving: Command) -> None:
        """Put the axle at `pose`, moving forward and turning; without a command it slows down."""
        v = moving.vx
        w = moving.w
        c = math.cos(pose.yaw)
        s = math.sin(pose.yaw)
        velocity = (c * v - s * w * self._com[0], s * v + c * w * self._com[0], 0.0)
        self.move(pose)
        self._bullet.resetBaseVelocity(self.body, velocity, (0.0, 0.0, w))
        turn = w * self.robot.track / 2.0
        for wheel, speed in zip(self._wheels, (v - turn, v + turn), strict=True):
            self._bullet.resetJointState(self.body, wheel, 0.0, speed / self.robot.wheel_radius)
        self._held_command.reset()
        self._setpoint = Command(v, w)
        self._held = None

    def move(self, pose: Pose) -> None:
        """Put the axle at `pose`; wheels, motors and firmware stay as they are."""
        c = math.cos(pose.yaw)
        s = math.sin(pose.yaw)
        # Bullet's base position is the center of mass, not the axle.
        position = (pose.x + c * self._com[0], pose.y + s * self._com[0], self._com[2])
        self._bullet.resetBasePositionAndOrientation(
            self.body, position, quaternion_from_yaw(pose.yaw)
        )

    def command(self, command: Command, time: float) -> None:
        """Execute a command for 0.15 s from `time` (s) on."""
        limits = self.robot.limits
        v = max(-limits.backward, min(limits.v, command.vx))
        self._held_command.command(Command(v, clip(command.w, limits.w)), time)

    def commanded(self, time: float) -> Command | None:
        """Return the command that the base executes at `time` (s); None without one."""
        return self._held_command.commanded(time)

    def ramp(self, time: float, dt: float) -> None:
        """Move the setpoint toward the command for `dt` s, and set the motors."""
        target = self.commanded(time) or STOP
        self._setpoint = ramped(
            self._setpoint,
            target,
            dt,
            self.robot.limits,
            self.robot.stop,
        )
        turn = self._setpoint.w * self.robot.track / 2.0
        radius = self.robot.wheel_radius
        speeds = (self._setpoint.vx - turn) / radius, (self._setpoint.vx + turn) / radius
        if speeds != (0.0, 0.0):
            self._held = None
        elif self._held is None:
            states = self._bullet.getJointStates(self.body, self._wheels)
            if all(abs(state[1]) < _BLOCKED_BELOW for state in states):
                self._held = [state[0] for state in states]
        mode = self._bullet.VELOCITY_CONTROL
        held = {}
        if self._held is not None:
            mode = self._bullet.POSITION_CONTROL
            held = {"targetPositions": self._held, "positionGains": [_HOLDING_GAIN] * 2}
        self._bullet.setJointMotorControlArray(
            self.body,
            self._wheels,
            mode,
            targetVelocities=speeds,
            forces=self._torques,
            velocityGains=self._gains,
            **held,
        )

    def wheel_angles(self) -> list[float]:
        """Return the angles of the left and the right wheel in rad."""
        return [state[0] for state in self._bullet.getJointStates(self.body, self._wheels)]

    def state(self) -> RobotState:
        """Return the true state of the axle, in the frame of the physics."""
        position, quaternion = self._bullet.getBasePositionAndOrientation(self.body)
        linear, angular = self._bullet.getBaseVelocity(self.body)
        yaw = yaw_from_quaternion(*quaternion)
        c = math.cos(yaw)
        s = math.sin(yaw)
        pose = Pose(
            position[0] - c * self._com[0],
            position[1] - s * self._com[0],
            yaw,
        )
        return RobotState(
            pose,
            c * linear[0] + s * linear[1],
            angular[2],
        )
