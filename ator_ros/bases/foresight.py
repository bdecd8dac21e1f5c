"""Prediction of the state at which a command takes effect: latency of the control loop."""

from __future__ import annotations

from collections import deque

from ator_ros.bases.interface import Base
from ator_ros.world.state import STOP, Command, RobotState, World

_EXPIRES = 0.5  # s after which a command is forgotten: other programs may steer
_ROUNDING = 1e-6  # s
_PROMPT = 0.02  # s within which a command counts as computed immediately


class Foresight:
    """Predicts states forward to when the command for them moves the base (Smith predictor).

    Until then the robot follows the commands already sent. Without the delay in the control loop,
    plans may brake as hard as the base can. `latency` is the time in s from the stamp of a state
    until the command for it moves the base; 0: no prediction.
    """

    def __init__(self, base: Base, latency: float) -> None:
        self._base = base
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
        """Return `command`, which took `took` s to compute, or a stop if it is too late.

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
        robot = world.robot
        now = world.time
        end = now + self._latency
        command: Command | None = None
        for stamp, following in (*self._sent, (world.time, None)):
            acts = min(stamp + self._latency, end)
            if acts > now + _ROUNDING:
                robot = self._base.moved(robot, command, acts - now)
                now = acts
            command = following
        objects = {name: state.after(self._latency) for name, state in world.objects.items()}
        return World(end, robot, objects)

    def _forget(self, time: float) -> None:
        expired = time - self._latency - _EXPIRES
        while self._sent and self._sent[0][0] < expired:
            self._sent.popleft()
