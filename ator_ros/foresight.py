"""The state in which a command will find the robot, where word of its state takes time."""

from __future__ import annotations

import dataclasses
import math
from collections import deque

from ator_ros.geometry import Pose, wrap_angle
from ator_ros.robot import Limits, Robot
from ator_ros.world import BallState, Command, RobotState, World

_STEP = 0.01
_HOLDS = 0.5
"""Time in s after which a command counts no more: somebody else may steer."""
_ROUNDING = 1e-6


class Foresight:
    """Carries a late state on to the moment at which its answer moves the base.

    What the robot does meanwhile is known: it follows the commands that are on their way. So the delay is
    out of the control loop (Smith's predictor), and plans that brake as hard as the base can stay possible.

    Parameters
    ----------
    robot : Robot
        Limits, within which the base follows commands.
    latency : float
        Time in s from the moment that a state tells of until the command that answers it moves the base; 0:
        states are taken as they are.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self._limits = robot.limits
        self._latency = latency
        self._told: deque[tuple[float, Command]] = deque()

    def reset(self) -> None:
        """Forget all commands, as time begins anew."""
        self._told.clear()

    def told(self, time: float, command: Command) -> None:
        """Note the command that answers the state of `time` (s); of several the last one counts."""
        self._forget(time)
        if self._told and self._told[-1][0] >= time:
            self._told.pop()
        self._told.append((time, command))

    def ahead(self, world: World) -> World:
        """Give the world as it will be when the answer to `world` moves the base, with the time then."""
        if self._latency == 0.0:
            return world
        self._forget(world.time)
        robot, now, end = world.robot, world.time, world.time + self._latency
        command: Command | None = None
        for answered, following in (*self._told, (world.time, None)):
            acts = min(answered + self._latency, end)
            if acts > now + _ROUNDING:
                robot, now = _driven(robot, command, acts - now, self._limits), acts
            command = following
        return World(end, robot, _rolled(world.ball, self._latency))

    def _forget(self, time: float) -> None:
        while self._told and self._told[0][0] < time - self._latency - _HOLDS:
            self._told.popleft()


def _driven(robot: RobotState, command: Command | None, duration: float, limits: Limits) -> RobotState:
    """Give the robot after `duration` s in which it follows `command`; without one it goes on as it does."""
    (x, y, yaw), v, w = robot.pose, robot.v, robot.w
    steps = math.ceil(duration / _STEP - _ROUNDING)
    dt = duration / steps
    for _ in range(steps):
        if command is not None:
            losing = abs(command.v) < abs(v) or command.v * v < 0.0
            v = _toward(command.v, v, (limits.brake if losing else limits.a) * dt)
            w = _toward(command.w, w, limits.aw * dt)
        x, y, yaw = x + v * dt * math.cos(yaw), y + v * dt * math.sin(yaw), yaw + w * dt
    return RobotState(Pose(x, y, wrap_angle(yaw)), v, w)


def _toward(target: float, value: float, most: float) -> float:
    return value + max(-most, min(most, target - value))


def _rolled(ball: BallState | None, duration: float) -> BallState | None:
    if ball is None:
        return None
    return dataclasses.replace(ball, x=ball.x + ball.vx * duration, y=ball.y + ball.vy * duration)
