"""What a domain says of each of its actions: a new action is a new specification."""

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
    """One action of a set: how it is made, how experience of it is gathered, what its model learns from.

    Attributes
    ----------
    name : str
        Name of the action, as TOPs name it; the same in every set.
    factory : callable
        Makes the action for a robot; the class of the action, for example.
    sample : callable
        Draws a situation to gather experience in, from a robot and a generator, which is its only source of
        chance. The sampler must not request what the robot cannot do: such episodes fail and teach nothing.
    features : tuple of str
        Names of the candidate features of its performance model, from which the model tree selects: general
        ones (`ator_ros.performance.features.GENERAL`) and those that the domain adds (`Domain.features`). One
        of them may be the action's ideal time (`Feature.ideal`): how long it would take at the robot's
        limits. Empty: all general candidates. The action's own goal variables are candidates besides.
    remote : RemoteCall or None
        The action server that executes it; None: the factory's action does.
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
        """Why the simulator cannot execute it, in words: its server has no stand-in; None where it can."""
        if self.factory is not UnreachableAction:
            return None
        return f"{self.name} has no `stand_in`, so only `collect --over-ros` and the nodes can execute it"
