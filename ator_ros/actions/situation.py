"""A situation: the state in which an action starts, and its goal (paper, section 3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ator_ros.actions.base import Goal
from ator_ros.world.state import ObjectState, RobotState


@dataclass(frozen=True, slots=True)
class Situation:
    """The state in which an action starts, and its goal.

    Attributes
    ----------
    action : str
        Name of the action.
    robot : RobotState
        Pose and velocities at the start.
    objects : mapping of str to ObjectState
        The objects at the start, by name.
    goal : Goal
        The action's goal.
    """

    action: str
    robot: RobotState
    objects: Mapping[str, ObjectState] = field(hash=False)
    goal: Goal
