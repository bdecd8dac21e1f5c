"""Between the execution of a goal and the base: foresight, and a watch on how it moves (without ROS)."""

from __future__ import annotations

import math

from ator_ros.execution.execution import Execution
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.robot.description import Robot
from ator_ros.robot.foresight import Foresight
from ator_ros.world.state import Command, RobotState, World


class Driving:
    """Carries late states on, and ends a goal whose base does not move as it was commanded to.

    Parameters
    ----------
    robot : Robot
        Limits and lags of the base.
    latency : float
        See `Foresight`.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self._watch = MotionWatch(robot, latency)
        self._foresight = Foresight(robot, latency)

    def reset(self) -> None:
        """Forget everything, as time begins anew."""
        self._foresight.reset()
        self._watch.reset()

    def begin(self, *, preempts: bool) -> None:
        """Begin to watch, for a goal: before it, anybody may have steered or pushed the base.

        Where it `preempts` another, only we have steered, and commands may still be on their way.
        """
        if not preempts:
            self._watch.reset()

    def sent(self, time: float, command: Command, now: float = -math.inf) -> None:
        """Note a command that leaves as the answer to a state of `time` (s); see `MotionWatch.sent`."""
        self._watch.sent(time, command, now)
        self._foresight.sent(time, command)

    def punctual(self, robot: RobotState, command: Command, took: float) -> Command:
        """Return the command to send now for one that took `took` s to compute; see `Foresight.punctual`."""
        return self._foresight.punctual(robot, command, took)

    def ahead(self, world: World, execution: Execution | None, now: float) -> World:
        """Return the world in which the answer to `world` will move the base.

        Parameters
        ----------
        world : World
            The state as the sensors tell it.
        execution : Execution or None
            What is executed; it ends where the base misbehaves.
        now : float
            Real time in s.
        """
        fault = None if execution is None else self._watch.fault(world.time, world.robot, now)
        if execution is not None and fault is not None:
            execution.misbehaved(fault)
        return self._foresight.ahead(world)
