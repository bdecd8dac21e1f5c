"""An omnidirectional base in a simulated world: its body, its firmware, and the friction below."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.bases.omni.planar_response import planar_ramp, within_limits
from ator_ros.geometry import Pose, clip, quaternion_from_yaw, yaw_from_quaternion
from ator_ros.simulation.bodies import BulletClient, load_omni_base
from ator_ros.simulation.simulated_base import HeldCommand
from ator_ros.world.state import STOP, Command, RobotState


class SimulatedOmniBase:
    """A base that moves in any direction, and its firmware.

    The firmware sets a velocity that follows the command within the limits. The motors are a force
    and a torque on the body, by which its velocity follows the set one with the described lag. The
    force is at most what the friction of the wheels transmits, so that a wall or another robot
    stops the base.

    Parameters
    ----------
    client : BulletClient
        The world.
    robot : OmniRobot
        The description.

    Attributes
    ----------
    body : int
        Body id.
    """

    def __init__(self, client: BulletClient, robot: OmniRobot) -> None:
        self._bullet = client
        self.robot = robot
        self.body, self._feet = load_omni_base(client, robot)
        dynamics = client.getDynamicsInfo(self.body, -1)
        self._inertia = float(dynamics[2][2])
        self._com_height = float(dynamics[3][2])
        self._held_command = HeldCommand()
        self._setpoint = STOP
        self._rates = robot.limits.rates

    def ignore(self, floor: int, others: Iterable[int]) -> None:
        """Leave out pairs that never touch: the body with the floor, its feet with all others."""
        self._bullet.setCollisionFilterPair(self.body, floor, -1, -1, 0)
        for other in others:
            for link in range(-1, self._bullet.getNumJoints(other)):
                for foot in self._feet:
                    self._bullet.setCollisionFilterPair(self.body, other, foot, link, 0)

    def place(self, pose: Pose, moving: Command) -> None:
        """Put the robot at `pose`, moving; without a command it slows down."""
        self.move(pose)
        over_floor = _turned(moving.vx, moving.vy, pose.yaw)
        self._bullet.resetBaseVelocity(self.body, (*over_floor, 0.0), (0.0, 0.0, moving.w))
        self._held_command.reset()
        self._setpoint = moving

    def move(self, pose: Pose) -> None:
        """Put the robot at `pose`; its velocity and firmware stay as they are."""
        self._bullet.resetBasePositionAndOrientation(
            self.body, (pose.x, pose.y, self._com_height), quaternion_from_yaw(pose.yaw)
        )

    def command(self, command: Command, time: float) -> None:
        """Execute a command, within the limits, for 0.15 s from `time` (s) on."""
        self._held_command.command(within_limits(command, self.robot.limits), time)

    def commanded(self, time: float) -> Command | None:
        """Return the command that the base executes at `time` (s); None without one."""
        return self._held_command.commanded(time)

    def ramp(self, time: float, dt: float) -> None:
        """Move the set velocity toward the command for `dt` s, and set the force."""
        robot = self.robot
        target = self.commanded(time) or STOP
        self._setpoint = planar_ramp(self._setpoint, target, dt, self._rates, robot.stop)
        position, quaternion = self._bullet.getBasePositionAndOrientation(self.body)
        (vx, vy, _), (_, _, w) = self._bullet.getBaseVelocity(self.body)
        yaw = yaw_from_quaternion(*quaternion)
        set_vx, set_vy = _turned(self._setpoint.vx, self._setpoint.vy, yaw)
        # A first-order lag, exactly over a step.
        follows = (1.0 - math.exp(-dt / robot.motor_time_constant)) / dt
        ax = follows * (set_vx - vx)
        ay = follows * (set_vy - vy)
        size = math.hypot(ax, ay)
        share = min(1.0, robot.grip / size) if size > 0.0 else 0.0
        force = (robot.mass * share * ax, robot.mass * share * ay, 0.0)
        # The wheels that transmit the force also turn the robot, at the distance of its reach.
        most_turning = robot.mass * robot.grip * robot.half_width
        torque = clip(self._inertia * follows * (self._setpoint.w - w), most_turning)
        frame = self._bullet.WORLD_FRAME
        self._bullet.applyExternalForce(self.body, -1, force, position, frame)
        self._bullet.applyExternalTorque(self.body, -1, (0.0, 0.0, torque), frame)

    def wheel_angles(self) -> list[float]:
        """Return no angles: the wheels are not simulated."""
        return []

    def state(self) -> RobotState:
        """Return the true state, in the frame of the physics."""
        (x, y, _), quaternion = self._bullet.getBasePositionAndOrientation(self.body)
        (vx, vy, _), (_, _, w) = self._bullet.getBaseVelocity(self.body)
        yaw = yaw_from_quaternion(*quaternion)
        ahead, aside = _turned(vx, vy, -yaw)
        return RobotState(Pose(x, y, yaw), ahead, w, vy=aside)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned by an angle in rad."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y
