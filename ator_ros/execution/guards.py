"""What ends or pauses a step whatever its action does: objects that are missing, and the fence."""

from __future__ import annotations

from typing import NamedTuple

from ator_ros.execution.fence import Fence, FenceWatch
from ator_ros.execution.phases import Ending
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top, TopCall
from ator_ros.tops.objects import missing_object, objects_in
from ator_ros.world.state import World


class Fault(NamedTuple):
    """Why a goal must end."""

    ending: Ending
    reason: str


class Guards:
    """Checks each state in which a step is executed.

    Parameters
    ----------
    fence : Fence
        The area in which the robot may drive.
    robot : Robot
        Its limits.
    longest_gap : float
        Greatest time in s between two states.
    """

    def __init__(self, fence: Fence, robot: Robot, longest_gap: float) -> None:
        self._fence = FenceWatch(fence, robot, longest_gap)
        self._blind: str | None = None

    def check(self, world: World, call: TopCall, overdue: frozenset[str]) -> Fault | str | None:
        """Return why the goal must end, or in words why the step pauses, or None.

        A step pauses while an object that it needs is overdue. The goal ends if that object is unknown in two
        states in a row.
        """
        top = call.top
        blind, self._blind = self._blind, missing_object(top, world)
        # One state may lack an object: after a long tick odometry may be read before the object's message.
        if self._blind and blind:
            return missing(self._blind, top)
        silent = self._blind or next((name for name in objects_in(top) if name in overdue), None)
        if silent:
            return f"{top.name} pauses: no word of the {silent}"
        fault = self._fence.fault(world, call)
        if fault is not None:
            return Fault(Ending.OUT_OF_BOUNDS, fault)
        return f"{top.name} pauses: what it follows leads out of the fence" if self._fence.pausing else None


def missing(name: str, top: Top) -> Fault:
    """Return the fault of an object that a TOP needs and that is unknown."""
    return Fault(Ending.INPUT_LOST, f"{name} is missing: {top.name} needs it, and no recent one is known")
