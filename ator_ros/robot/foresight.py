"""The state in which a command will find the robot, where word of its state takes time."""

from __future__ import annotations

import math
from collections import deque

from ator_ros.geometry import Pose, wrap_angle
from ator_ros.robot.description import Limits, Robot
from ator_ros.robot.ramp import ramped
from ator_ros.world.state import STOP, Command, RobotState, World

_STEP = 0.01  # s of a step of what is foreseen
_HOLDS = 0.5  # s after which a command counts no more: somebody else may steer
_ROUNDING = 1e-6  # s
_PROMPT = 0.02  # s that an answer may take and still count as given at once


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
        self._sent: deque[tuple[float, Command]] = deque()
        self._held_back = False

    def reset(self) -> None:
        """Forget all commands, as time begins anew."""
        self._sent.clear()
        self._held_back = False

    def sent(self, time: float, command: Command) -> None:
        """Note a command that leaves as the answer to a state of `time` (s); of several the last counts."""
        self._forget(time)
        while self._sent and self._sent[-1][0] >= time:
            self._sent.pop()
        self._sent.append((time, command))

    def punctual(self, robot: RobotState, command: Command, took: float) -> Command:
        """Return the answer to send to a robot in this foreseen state, where `command` took so long (s).

        A robot that stands is not started by an answer that leaves late, as where planning has taken
        its time: it would be foreseen to drive before it does. Its plan starts with the next state instead,
        whatever that one's answer takes: on a computer that is always late it starts all the same.
        """
        late = self._latency > 0.0 and robot.is_still and took > _PROMPT
        self._held_back = late and not self._held_back
        return STOP if self._held_back else command

    def ahead(self, world: World) -> World:
        """Return the world as it will be when the answer to `world` moves the base, with the time then."""
        if self._latency == 0.0:
            return world
        self._forget(world.time)
        robot, now, end = world.robot, world.time, world.time + self._latency
        command: Command | None = None
        for left, following in (*self._sent, (world.time, None)):
            acts = min(left + self._latency, end)
            if acts > now + _ROUNDING:
                robot, now = _driven(robot, command, acts - now, self._limits), acts
            command = following
        ball = None if world.ball is None else world.ball.after(self._latency)
        return World(end, robot, ball)

    def _forget(self, time: float) -> None:
        while self._sent and self._sent[0][0] < time - self._latency - _HOLDS:
            self._sent.popleft()


def _driven(robot: RobotState, command: Command | None, duration: float, limits: Limits) -> RobotState:
    """Return the robot after `duration` s in which it follows `command`; without one it keeps its speed."""
    (x, y, yaw), speeds = robot.pose, Command(robot.v, robot.w)
    steps = math.ceil(duration / _STEP - _ROUNDING)
    dt = duration / steps
    for _ in range(steps):
        if command is not None:
            speeds = ramped(speeds, command, dt, limits)
        way = speeds.v * dt
        x, y, yaw = x + way * math.cos(yaw), y + way * math.sin(yaw), yaw + speeds.w * dt
    return RobotState(Pose(x, y, wrap_angle(yaw)), speeds.v, speeds.w)
