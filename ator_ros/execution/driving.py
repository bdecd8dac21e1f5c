"""Between execution and base: compensation of latency, and detection of a base that does not obey."""

from __future__ import annotations

import math

from ator_ros.execution.execution import Execution
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.robot.description import Robot
from ator_ros.robot.foresight import Foresight
from ator_ros.world.state import Command, RobotState, World


class Driving:
    """Predicts late states forward, and ends a goal if the base does not move as commanded.

    Parameters
    ----------
    robot : Robot
        Limits and lag of the base.
    latency : float
        See `Foresight`.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self._robot = robot
        self._use(latency)

    def _use(self, latency: float) -> None:
        self._latency = latency
        self._watch = MotionWatch(self._robot, latency)
        self._foresight = Foresight(self._robot, latency)

    def reset(self) -> None:
        """Forget all states and commands because time was reset."""
        self._foresight.reset()
        self._watch.reset()

    def begin(self, latency: float, *, preempts: bool) -> None:
        """Begin to watch the base for a new goal, with a latency that may be another one.

        Motion before the goal is ignored, as others may have moved the base. A goal that `preempts` another
        continues its watch, and with the latency of before: its commands may still be under way.
        """
        if preempts:
            return
        if latency != self._latency:
            self._use(latency)
        self._watch.reset()

    def sent(self, time: float, command: Command | None, now: float = -math.inf) -> None:
        """Record a command sent in response to the state of `time` (s); see `MotionWatch.sent`.

        None: another program moves the base, so its motion is not compared with our commands.
        """
        if command is None:
            self._watch.reset()
        else:
            self._watch.sent(time, command, now)
        self._foresight.sent(time, command)

    def punctual(self, robot: RobotState, command: Command | None, took: float) -> Command | None:
        """Return the command to send now for one that took `took` s to compute; see `Foresight.punctual`."""
        return self._foresight.punctual(robot, command, took)

    def ahead(self, world: World, execution: Execution | None, now: float) -> World:
        """Return the world at the time when the command for `world` takes effect.

        Parameters
        ----------
        world : World
            The measured state.
        execution : Execution or None
            The execution to end if the base does not obey.
        now : float
            Real time in s.
        """
        fault = None if execution is None else self._watch.fault(world.time, world.robot, now)
        if execution is not None and fault is not None:
            execution.misbehaved(fault)
        return self._foresight.ahead(world)
