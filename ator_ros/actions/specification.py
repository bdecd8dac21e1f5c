"""The specification of an action: each action of a domain has one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.base import Action
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.remote import RemoteCall, UnreachableAction
from ator_ros.actions.situation import Situation
from ator_ros.robot.description import Robot

ActionFactory = Callable[[Robot], Action]
Sampler = Callable[[Robot, np.random.Generator], Situation]


@dataclass(frozen=True)
class ActionSpec:
    """One action of a set: its factory, the situations to learn it in, and the features of its model.

    Attributes
    ----------
    name : str
        Name of the action, as TOPs name it; the same in every set.
    factory : callable
        Makes the action for a robot, such as the class of the action.
    sample : callable
        Draws a situation to learn in, for a robot, with a generator. It must not request what the robot
        cannot do: such episodes fail, and nothing is learned from them.
    features : tuple of str
        Names of the candidate features of its performance model, from which the model tree selects: general
        ones (`ator_ros.performance.features.GENERAL`) and those that the domain adds (`Domain.features`).
        Empty: `CANDIDATES`. The action's own goal variables are candidates besides.
    remote : RemoteCall or None
        The action server that executes it; None: the action of the factory executes it.
    goal_variables : tuple of GoalVariable
        The variables of its goals beyond pose and arrival speed: every goal has a value of each.
    """

    name: str
    factory: ActionFactory
    sample: Sampler
    features: tuple[str, ...] = ()
    remote: RemoteCall | None = None
    goal_variables: tuple[GoalVariable, ...] = ()

    @property
    def over_ros_only(self) -> str | None:
        """Why the simulator cannot execute it: its server has no stand-in; None if it can."""
        if self.factory is not UnreachableAction:
            return None
        return f"{self.name} has no `stand_in`, so only `collect --over-ros` and the nodes can execute it"
