"""How a base reacts to commands: the speeds that it shows, beside those that its description lets expect."""

from __future__ import annotations

from dataclasses import dataclass

from ator_ros.robot.description import Robot
from ator_ros.robot.response import ramped
from ator_ros.world.state import STOP, Command, RobotState, World


@dataclass(frozen=True, slots=True)
class Reaction:
    """What a base did in one tick.

    Attributes
    ----------
    passed : float
        Duration of the tick in s.
    before, set : Command
        Speeds at its beginning and end that the commands ask of a base as described, without any lag.
    was, now : RobotState
        States of the robot at its beginning and end.
    """

    passed: float
    before: Command
    set: Command
    was: RobotState
    now: RobotState


class Reactions:
    """Tells the reactions of a base to the commands that it is sent.

    Parameters
    ----------
    robot : Robot
        Limits within which the base should follow commands.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._last: World | None = None
        self._command, self._set = STOP, STOP

    def sent(self, command: Command) -> None:
        """Take in the command for the state that was seen last."""
        self._command = command

    def see(self, world: World) -> Reaction | None:
        """Return the reaction since the state that was seen last; None where this is the first one."""
        last, before = self._last, self._set
        self._last = world
        if last is None or world.time <= last.time:
            self._set = Command(world.robot.v, world.robot.w)
            return None
        passed = world.time - last.time
        self._set = ramped(before, self._command, passed, self._robot.limits, self._robot.stop)
        return Reaction(passed, before, self._set, last.robot, world.robot)
