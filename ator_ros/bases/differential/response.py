"""The response of a base to velocity commands, with limits and latency, and the prediction of its state."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.bases.description import Limits, Robot, StopBraking
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.world.state import STOP, Command, RobotState, World


def ramped(
    speeds: Command, target: Command, dt: float, limits: Limits, stop: StopBraking
) -> Command:
    """Return the velocities of a base `dt` s after `speeds` if it is commanded to `target`."""
    if target == STOP:
        most = Command(_braking(speeds.v, stop), stop.turning)
    else:
        losing = abs(target.v) < abs(speeds.v) or target.v * speeds.v < 0.0
        most = Command(limits.brake if losing else limits.a, limits.aw)
    return Command(
        speeds.v + clip(target.v - speeds.v, most.v * dt),
        speeds.w + clip(target.w - speeds.w, most.w * dt),
    )


def stopping_distance(v: float, stop: StopBraking) -> float:
    """Return the signed stopping distance in m at `v` (m/s) after a command to stop."""
    return v * abs(v) / (2.0 * _braking(v, stop))


def _braking(v: float, stop: StopBraking) -> float:
    return stop.backward if v < 0.0 else stop.forward


def clip(value: float, bound: float) -> float:
    """Return `value` clipped to [-bound, bound]."""
    return max(-bound, min(bound, value))


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
        state, now, command, following = (0.0, 0.0), times[0], 0.0, 0
        for number, time in enumerate(times):
            while following < number and times[following] + self.latency < time:
                acts = max(now, times[following] + self.latency)
                state, now = self._after(state, command, acts - now), acts
                command, following = clip(commands[following], self.limit), following + 1
            state, now = self._after(state, command, time - now), time
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
            if command == 0.0:
                rate = self.stop
            else:
                rate = self.loss if reversing or abs(command) < abs(setpoint) else self.gain
            span = min(seconds, abs(aim - setpoint) / rate) if aim != setpoint else seconds
            slope = math.copysign(rate, aim - setpoint) if aim != setpoint else 0.0
            behind = slope * self.lag
            new = setpoint + slope * span if span < abs(aim - setpoint) / rate else aim
            speed = new - behind + (speed - setpoint + behind) * math.exp(-span / self.lag)
            setpoint, seconds = new, seconds - span
        return setpoint, speed


_STEP = 0.01  # s of a step of the prediction
_EXPIRES = 0.5  # s after which a command is forgotten: other programs may steer
_ROUNDING = 1e-6  # s
_PROMPT = 0.02  # s within which a command counts as computed immediately


class Foresight:
    """Predicts a state forward to the time at which the command for it moves the base (Smith predictor).

    Until then the robot follows the commands already sent. Without the delay in the control loop,
    plans may brake as hard as the base can. `latency` is the time in s from the stamp of a state
    until the command for it moves the base; 0: no prediction.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self._limits, self._stop = robot.limits, robot.stop
        self._latency = latency
        self._sent: deque[tuple[float, Command | None]] = deque()
        self._held_back = False

    def reset(self) -> None:
        """Forget all commands because time was reset."""
        self._sent.clear()
        self._held_back = False

    def sent(self, time: float, command: Command | None) -> None:
        """Record the last command sent for the state of `time` (s).

        None: another program moves the robot, whose velocity is predicted to be constant.
        """
        self._forget(time)
        while self._sent and self._sent[-1][0] >= time:
            self._sent.pop()
        self._sent.append((time, command))

    def punctual(self, robot: RobotState, command: Command | None, took: float) -> Command | None:
        """Return `command`, which took `took` s to compute, or a stop if it comes too late for `robot`.

        A late command does not start a robot at rest, because the prediction would be ahead of the
        motion. The robot starts with the command for the next state, even if that is late too, as
        on a slow computer.
        """
        late = command is not None and self._latency > 0.0 and robot.is_still and took > _PROMPT
        self._held_back = late and not self._held_back
        return STOP if self._held_back else command

    def ahead(self, world: World) -> World:
        """Return the world at the time at which the command for `world` moves the base."""
        if self._latency == 0.0:
            return world
        self._forget(world.time)
        robot, now, end = world.robot, world.time, world.time + self._latency
        command: Command | None = None
        for stamp, following in (*self._sent, (world.time, None)):
            acts = min(stamp + self._latency, end)
            if acts > now + _ROUNDING:
                robot, now = _driven(robot, command, acts - now, self._limits, self._stop), acts
            command = following
        objects = {name: state.after(self._latency) for name, state in world.objects.items()}
        return World(end, robot, objects)

    def _forget(self, time: float) -> None:
        while self._sent and self._sent[0][0] < time - self._latency - _EXPIRES:
            self._sent.popleft()


def _driven(
    robot: RobotState, command: Command | None, duration: float, limits: Limits, stop: StopBraking
) -> RobotState:
    """Return the robot after `duration` s of `command`; None: at constant velocity."""
    (x, y, yaw), speeds = robot.pose, Command(robot.v, robot.w)
    steps = math.ceil(duration / _STEP - _ROUNDING)
    dt = duration / steps
    for _ in range(steps):
        if command is not None:
            speeds = ramped(speeds, command, dt, limits, stop)
        step = speeds.v * dt
        x, y, yaw = x + step * math.cos(yaw), y + step * math.sin(yaw), yaw + speeds.w * dt
    return RobotState(Pose(x, y, wrap_angle(yaw)), speeds.v, speeds.w)
