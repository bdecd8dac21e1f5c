"""The motors of the wheels: velocity control while the base moves, position control while it stands."""

from __future__ import annotations

from ator_ros.robot.description import Robot
from ator_ros.simulation import physics as p

_BLOCKED_BELOW = 0.05  # rad/s of a wheel that is to stand: then the firmware holds it in its place
_HOLDING_GAIN = 0.1


class Motors:
    """Two wheels' motors with bounded torque.

    Under velocity control alone a standing base would creep by a millirad a second; firmware holds its place.

    Parameters
    ----------
    client, body : int
        Where the wheels are.
    wheels : list of int
        Joint indices of the left and the right wheel.
    robot : Robot
        Torque and lag of the motors.
    period : float
        Time of a physics step in s.
    """

    def __init__(self, client: int, body: int, wheels: list[int], robot: Robot, *, period: float) -> None:
        self._client, self._body, self._wheels = client, body, wheels
        self._torques = [robot.wheel_torque] * 2
        self._gains = [period / robot.motor_time_constant] * 2
        self._held: list[float] | None = None

    def turn(self, speeds: tuple[float, float]) -> None:
        """Ask for the speeds (rad/s) of the left and the right wheel during the next step."""
        if speeds != (0.0, 0.0):
            self._held = None
        elif self._held is None:
            self._held = self._still()
        if self._held is None:
            self._control(p.VELOCITY_CONTROL, targetVelocities=speeds)
        else:
            self._control(
                p.POSITION_CONTROL,
                targetPositions=self._held,
                targetVelocities=speeds,
                positionGains=[_HOLDING_GAIN] * 2,
            )

    def release(self) -> None:
        """Forget where the wheels stood, since the robot was moved."""
        self._held = None

    def _still(self) -> list[float] | None:
        """Return the wheels' angles in rad, or None while they turn."""
        states = p.getJointStates(self._body, self._wheels, physicsClientId=self._client)
        return (
            [state[0] for state in states]
            if all(abs(state[1]) < _BLOCKED_BELOW for state in states)
            else None
        )

    def _control(self, mode: int, **targets: object) -> None:
        p.setJointMotorControlArray(
            self._body,
            self._wheels,
            mode,
            forces=self._torques,
            velocityGains=self._gains,
            physicsClientId=self._client,
            **targets,
        )
