"""Compensation of latency: the state at the time when a command takes effect."""

from __future__ import annotations

import math
from collections import deque

from ator_ros.geometry import Pose, wrap_angle
from ator_ros.robot.description import Limits, Robot, StopBraking
from ator_ros.robot.ramp import ramped
from ator_ros.world.state import STOP, Command, RobotState, World

_STEP = 0.01  # s of a step of the prediction
_HOLDS = 0.5  # s after which a command is forgotten: others may steer
_ROUNDING = 1e-6  # s
_PROMPT = 0.02  # s within which a command counts as computed at once


class Foresight:
    """Predicts a late state forward to the time when the command for it moves the base.

    Until then the robot follows the commands already sent, which are known. This takes the delay out of the
    control loop (Smith predictor), so that plans may brake as hard as the base can.

    Parameters
    ----------
    robot : Robot
        Its limits, within which the base follows commands.
    latency : float
        Time in s from the stamp of a state until the command for it moves the base; 0: no prediction.
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
        """Record a command sent for the state of `time` (s); a later one for the same state replaces it.

        None: another program moves the robot, which is predicted to keep its velocity.
        """
        self._forget(time)
        while self._sent and self._sent[-1][0] >= time:
            self._sent.pop()
        self._sent.append((time, command))

    def punctual(self, robot: RobotState, command: Command | None, took: float) -> Command | None:
        """Return the command to send for `command`, which took `took` s to compute, in the predicted state.

        A late command does not start a resting robot; the prediction would lead the motion. The robot starts
        with the command for the next state, even if that is late as well: on a slow computer every command
        may be late.
        """
        late = command is not None and self._latency > 0.0 and robot.is_still and took > _PROMPT
        self._held_back = late and not self._held_back
        return STOP if self._held_back else command

    def ahead(self, world: World) -> World:
        """Return the world, with its time, when the command for `world` moves the base."""
        if self._latency == 0.0:
            return world
        self._forget(world.time)
        robot, now, end = world.robot, world.time, world.time + self._latency
        command: Command | None = None
        for left, following in (*self._sent, (world.time, None)):
            acts = min(left + self._latency, end)
            if acts > now + _ROUNDING:
                robot, now = _driven(robot, command, acts - now, self._limits, self._stop), acts
            command = following
        objects = {name: state.after(self._latency) for name, state in world.objects.items()}
        return World(end, robot, objects)

    def _forget(self, time: float) -> None:
        while self._sent and self._sent[0][0] < time - self._latency - _HOLDS:
            self._sent.popleft()


def _driven(
    robot: RobotState, command: Command | None, duration: float, limits: Limits, stop: StopBraking
) -> RobotState:
    """Return the robot after following `command` for `duration` s; None: it keeps its velocity."""
    (x, y, yaw), speeds = robot.pose, Command(robot.v, robot.w)
    steps = math.ceil(duration / _STEP - _ROUNDING)
    dt = duration / steps
    for _ in range(steps):
        if command is not None:
            speeds = ramped(speeds, command, dt, limits, stop)
        way = speeds.v * dt
        x, y, yaw = x + way * math.cos(yaw), y + way * math.sin(yaw), yaw + speeds.w * dt
    return RobotState(Pose(x, y, wrap_angle(yaw)), speeds.v, speeds.w)
