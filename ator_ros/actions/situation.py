"""Situations: the state in which an action starts, and its goal.

How actions draw them (paper, section 3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from ator_ros.actions.base import Action, Goal
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.remote import RemoteCall, UnreachableAction
from ator_ros.bases.description import ConfigError, Robot
from ator_ros.bases.routes import reachable
from ator_ros.geometry import Pose
from ator_ros.world.state import ObjectState, RobotState

T = TypeVar("T")

_MOST_DRAWS = 10_000  # of a sampler, which needs a few tens in scenes with enough room

SHORT = 0.5
"""Distance in m between start and goal below which a drive is short."""
# Shares of situations, so that one in seven is short: enough for the leaves of a tree.
_TURNS = 0.06  # the robot turns on the spot
_SHORT_DRIVES = 0.06  # it drives less than `SHORT`
_STAYS = 0.03  # it is at its goal
# Between start and goal of a robot that is at its goal: within the tolerances of usual TOPs.
_STAYS_WITHIN = 0.03  # m
_STAYS_TURNED = 0.08  # rad


class NoPlaceError(ConfigError):
    """No situation can be drawn for this robot in its scene."""


@dataclass(frozen=True, slots=True)
class Situation:
    """The state in which an action starts (the robot, and the objects by name), and its goal."""

    action: str
    robot: RobotState
    objects: Mapping[str, ObjectState] = field(hash=False)
    goal: Goal


def drawn_until(
    draw: Callable[[], T],
    fits: Callable[[T], bool],
    expected: Callable[[], str],
    *,
    most: int = _MOST_DRAWS,
) -> T:
    """Draw until `fits` returns true.

    Raises
    ------
    NoPlaceError
        None of `most` draws fitted; the message begins with what `expected` returns.
    """
    for _ in range(most):
        found = draw()
        if fits(found):
            return found
    raise NoPlaceError(expected() if most == 1 else f"{expected()}: none of {most} draws fits")


def short_goal(
    start: Pose,
    rng: np.random.Generator,
    *,
    turns: bool = True,
) -> Pose | None:
    """Draw a goal near the start of the robot, or of the object that it holds.

    None in six of seven cases. It is a turn on the spot by any angle (if `turns`), a goal closer
    than `SHORT` in any direction with any heading, or the start itself, exactly or within
    centimeters.
    """
    share = rng.random()
    heading = float(rng.uniform(-math.pi, math.pi))
    if share < _TURNS:
        return start._replace(yaw=heading) if turns else None
    if share < _TURNS + _SHORT_DRIVES:
        return _displaced(start, rng, SHORT)._replace(yaw=heading)
    if share < _TURNS + _SHORT_DRIVES + _STAYS:
        exactly = rng.random() >= 0.5
        there = _displaced(start, rng, 0.0 if exactly else _STAYS_WITHIN)
        angle = 0.0 if exactly else _STAYS_TURNED
        return there._replace(yaw=start.yaw + float(rng.uniform(-angle, angle)))
    return None


def _displaced(
    pose: Pose,
    rng: np.random.Generator,
    most: float,
) -> Pose:
    """Return a pose moved in a random direction by up to `most` m."""
    distance = rng.uniform(0.0, most)
    direction = rng.uniform(-math.pi, math.pi)
    return pose._replace(
        x=pose.x + float(distance * math.cos(direction)),
        y=pose.y + float(distance * math.sin(direction)),
    )


ActionFactory = Callable[[Robot], Action]
Sampler = Callable[[Robot, np.random.Generator], Situation]


@dataclass(frozen=True)
class ActionSpec:
    """One action of a set: its factory, situations to learn it in, and features of its model.

    Attributes
    ----------
    name : str
        Name of the action in TOPs; the same in every set.
    factory : callable
        Makes the action for a robot, such as the class of the action.
    sample : callable
        Draws a situation to learn in. It must be one that the robot can handle: nothing is learned
        from episodes that fail.
    features : tuple of str
        Names of the candidate features of its performance model, from which the model tree selects:
        general ones (`ator_ros.performance.features.GENERAL`) and those that the domain adds
        (`Domain.features`). Empty: `CANDIDATES`. The action's own goal variables are always
        candidates.
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

    def situation(
        self,
        robot: Robot,
        rng: np.random.Generator,
    ) -> Situation:
        """Draw a situation to learn in.

        On a map, one with a route to the goal. May raise NoPlaceError.
        """
        return drawn_until(
            lambda: self.sample(robot, rng),
            lambda found: reachable([found.robot.pose, found.goal.robot_pose(robot)], robot),
            lambda: (
                f"drives of {self.name}: expected free places with a route between them on the map"
            ),
        )

    @property
    def over_ros_only(self) -> str | None:
        """Why the simulator cannot execute it: its server has no stand-in; None if it can."""
        if self.factory is not UnreachableAction:
            return None
        needed = "so only `collect --over-ros` and the nodes can execute it"
        return f"{self.name} has no `stand_in`, {needed}"
