"""What a domain says of each of its actions; a new action is a new row of specifications."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.base import Action
from ator_ros.actions.remote import RemoteCall
from ator_ros.actions.situation import Situation
from ator_ros.robot.description import Robot

ActionFactory = Callable[[Robot], Action]
Sampler = Callable[[Robot, np.random.Generator], Situation]


@dataclass(frozen=True)
class ActionSpec:
    """One action of a set.

    Attributes
    ----------
    name : str
        Name of the action, the same in every set.
    factory : callable
        Makes the action for a robot: its class.
    sample : callable
        Draws a situation to gather experience in; the generator is its only source of chance.
    features : tuple of str
        Candidate features of its performance model, of which the model tree selects; empty: all general ones.
    remote : RemoteCall or None
        The action server that executes it; None: the factory's action does.
    """

    name: str
    factory: ActionFactory
    sample: Sampler
    features: tuple[str, ...] = ()
    remote: RemoteCall | None = None
