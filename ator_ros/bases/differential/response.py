"""The response of a base with two driven wheels to velocity commands, with limits and latency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.bases.differential.limits import Limits, StopBraking
from ator_ros.geometry import FloatArray, Pose, clip, wrap_angle
from ator_ros.world.state import STOP, Command, RobotState


def ramped(
    speeds: Command, target: Command, dt: float, limits: Limits, stop: StopBraking
) -> Command:
    """Return the velocities of a base `dt` s after `speeds` if it is commanded to `target`."""
    if target == STOP:
        most = Command(_braking(speeds.vx, stop), stop.turning)
    else:
        losing = abs(target.vx) < abs(speeds.vx) or target.vx * speeds.vx < 0.0
        most = Command(limits.brake if losing else limits.a, limits.aw)
    return Command(
        speeds.vx + clip(target.vx - speeds.vx, most.vx * dt),
        speeds.w + clip(target.w - speeds.w, most.w * dt),
    )


def stopping_distance(v: float, stop: StopBraking) -> float:
    """Return the signed stopping distance in m at `v` (m/s) after a command to stop."""
    return v * abs(v) / (2.0 * _braking(v, stop))


def _braking(v: float, stop: StopBraking) -> float:
    return stop.backward if v < 0.0 else stop.forward


@dataclass(frozen=True, slots=True)
class AxisResponse:
    """The response of one axis to commands.

    The set speed is clipped to `limit`; the measured speed follows it with a first-order lag.
    """

    latency: float  # s; from the stamp of a state until the command in response to it takes effect
    lag: float  # s; time constant
    limit: float  # m/s or rad/s; greatest speed
    gain: float  # m/s^2 or rad/s^2; greatest change of the set speed
    loss: float  # the same, for losing speed
    stop: float  # the same, when commanded to stand

    def speeds(self, times: Sequence[float], commands: Sequence[float]) -> FloatArray:
        """Return the speeds, shape (n,), of an axis that stands at the first of `times`.

        `times` are the ascending stamps of n states in s, `commands` the responses to them (m/s or
        rad/s).
        """
        found = np.zeros(len(times))
        state = (0.0, 0.0)
        now = times[0]
        command = 0.0
        following = 0  # number of the next command that acts
        for number, time in enumerate(times):
            while following < number and times[following] + self.latency < time:
                acts = max(now, times[following] + self.latency)
                state = self._after(state, command, acts - now)
                now = acts
                command = clip(commands[following], self.limit)
                following += 1
            state = self._after(state, command, time - now)
            now = time
            found[number] = state[1]
        return found

    def _after(
        self, state: tuple[float, float], command: float, seconds: float
    ) -> tuple[float, float]:
        """Return set and measured speed after `seconds` under one command, in closed form."""
        setpoint, speed = state
        while seconds > 0.0:
            reversing = setpoint * command < 0.0
            aim = 0.0 if reversing else command
            rate = self.gain
            if command == 0.0:
                rate = self.stop
            elif reversing or abs(command) < abs(setpoint):
                rate = self.loss
            span = seconds
            slope = 0.0
            new = aim
            if aim != setpoint:
                needed = abs(aim - setpoint) / rate  # s
                span = min(seconds, needed)
                slope = math.copysign(rate, aim - setpoint)
                new = setpoint + slope * span if span < needed else aim
            behind = slope * self.lag
            speed = new - behind + (speed - setpoint + behind) * math.exp(-span / self.lag)
            setpoint = new
            seconds -= span
        return setpoint, speed


_STEP = 0.01  # s of a step of the prediction
_ROUNDING = 1e-6  # steps


def driven(
    robot: RobotState,
    command: Command | None,
    duration: float,
    limits: Limits,
    stop: StopBraking,
) -> RobotState:
    """Return the robot after `duration` s of `command`; None: at constant velocity."""
    x, y, yaw = robot.pose
    speeds = robot.velocity
    steps = math.ceil(duration / _STEP - _ROUNDING)
    dt = duration / steps
    for _ in range(steps):
        if command is not None:
            speeds = ramped(speeds, command, dt, limits, stop)
        step = speeds.vx * dt
        x += step * math.cos(yaw)
        y += step * math.sin(yaw)
        yaw += speeds.w * dt
    return RobotState(Pose(x, y, wrap_angle(yaw)), speeds.vx, speeds.w)
