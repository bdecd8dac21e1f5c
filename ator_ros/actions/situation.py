"""A situation: the state in which an action starts, and its goal (paper, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

from ator_ros.actions.base import Goal
from ator_ros.world.state import BallState, RobotState


@dataclass(frozen=True, slots=True)
class Situation:
    """The state in which an action starts, and its goal.

    Attributes
    ----------
    action : str
        Name of the action.
    robot : RobotState
        Pose and velocities at the start.
    ball : BallState or None
        The ball at the start, None where none is on the field.
    goal : Goal
        The action's goal.
    """

    action: str
    robot: RobotState
    ball: BallState | None
    goal: Goal
