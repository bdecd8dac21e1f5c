"""A situation: the state in which an action starts, and its goal, and how it is drawn (paper, section 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from ator_ros.actions.base import Goal
from ator_ros.robot.description import ConfigError
from ator_ros.world.state import ObjectState, RobotState

T = TypeVar("T")

MOST_DRAWS = 10_000
"""Draws after which a sampler gives up: scenes in which samplers have room need some tens at most."""


class NoPlaceError(ConfigError):
    """No situation can be drawn for this robot in its scene; the message says what was expected and came."""


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


def drawn_until(
    draw: Callable[[], T], fits: Callable[[T], bool], expected: Callable[[], str], *, most: int = MOST_DRAWS
) -> T:
    """Draw until something fits.

    Parameters
    ----------
    draw, fits : callable
        Draws one, and returns whether it can be used.
    expected : callable
        Returns the words for where, what was expected, and what came.
    most : int
        Draws after which to give up.

    Raises
    ------
    NoPlaceError
        Nothing fitted.
    """
    for _ in range(most):
        found = draw()
        if fits(found):
            return found
    raise NoPlaceError(f"{expected()}: none of {most} draws fits")
