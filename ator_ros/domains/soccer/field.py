"""The soccer field: the area of the scene, with two goals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.domains.domain import Line
from ator_ros.domains.soccer.ball import BALL
from ator_ros.geometry import Pose
from ator_ros.robot.description import ConfigError, Robot
from ator_ros.world.scene import Bay, Scene
from ator_ros.world.state import ObjectState

_MISPLACED = 1e-5
"""In m and rad: how far a goal may be from the line's middle."""
_CENTRE_CIRCLE = 1.0  # m


@dataclass(frozen=True, slots=True)
class Field:
    """The field: its goals are on the two lines at right angles to the x axis.

    Attributes
    ----------
    length, width : float
        Between the lines, in m.
    goal_width, goal_depth : float
        Inner sizes of both goals in m; 0 where there are none.
    x, y : float
        The centre in m.
    """

    length: float
    width: float
    goal_width: float
    goal_depth: float
    x: float = 0.0
    y: float = 0.0

    @property
    def walls_begin(self) -> float:
        """Distance in m from the centre along x from which walls of goals stand; infinite without goals."""
        return self.length / 2 if self.goal_depth else math.inf

    def goal_centre(self, side: int = 1) -> tuple[float, float]:
        """Return the middle of the goal line of the goal at greater x (side 1) or smaller x (-1), in m."""
        return self.x + side * self.length / 2.0, self.y

    def side_of(self, x: float) -> int:
        """Return on which side of the centre x (m) lies: 1 at greater x, -1 otherwise."""
        return 1 if x > self.x else -1


def field_of(robot: Robot) -> Field:
    """Return the field of a robot's scene, which `goals_in` has checked, or which has no goals."""
    area, bays = robot.scene.area, robot.scene.bays
    width, depth = (bays[0].width, bays[0].depth) if bays else (0.0, 0.0)
    return Field(area.length, area.width, width, depth, area.x, area.y)


def behind_line(ball: ObjectState, mouth: Pose, field: Field) -> float:
    """Return how far in m a ball's centre lies behind the goal line of `mouth`; negative before it."""
    return (ball.x - mouth.x) * field.side_of(mouth.x)


def is_in_goal(ball: ObjectState, mouth: Pose, field: Field, beyond: float) -> bool:
    """Return whether the ball lies in the goal: when an action that shoots may end.

    Whether it has succeeded is for the post-condition of `shoot` to say.

    Parameters
    ----------
    ball : ObjectState
        The ball.
    mouth : Pose
        Middle of the goal's mouth; its heading does not matter.
    field : Field
        Its centre, and the width of the goals.
    beyond : float
        How far in m the ball's centre must lie behind the line; its radius, if the whole ball must.
    """
    return behind_line(ball, mouth, field) > beyond and abs(ball.y - mouth.y) < field.goal_width / 2


def field_in(scene: Scene) -> tuple[Bay, ...]:
    """Return the bays of a scene that soccer can be played in, for its ball is described.

    Raises
    ------
    ConfigError
        There is no ball, whose radius and mass the actions need; or the bays are no two equal goals.
    """
    if BALL not in scene.objects:
        raise ConfigError(f"scene.objects: expected {BALL!r} among them, got {sorted(scene.objects)}")
    return goals_in(scene)


def goals_in(scene: Scene) -> tuple[Bay, ...]:
    """Return the bays of a scene that soccer is played in: two equal goals on the lines, or none.

    Raises
    ------
    ConfigError
        The bays are no two equal goals.
    """
    (left, _, right, _), middle = scene.area.lines, scene.area.y
    sizes = {(bay.width, bay.depth) for bay in scene.bays}
    places = sorted((bay.x, bay.y, abs(bay.yaw)) for bay in scene.bays)
    if scene.bays and (
        len(sizes) > 1
        or not (
            len(places) == 2
            and math.dist(places[0], (left, middle, math.pi)) < _MISPLACED
            and math.dist(places[1], (right, middle, 0.0)) < _MISPLACED
        )
    ):
        raise ConfigError(
            f"scene.bays: expected two equal goals on the lines x = {left:.10g} and x = {right:.10g} at "
            f"y = {middle:.10g}, opening to the middle, or none, got {list(scene.bays)}"
        )
    return scene.bays


def field_lines(robot: Robot) -> Sequence[Line]:
    """Return the halfway line and the centre circle."""
    area, corners = robot.scene.area, np.linspace(0.0, 2.0 * np.pi, 49)
    _, y_min, _, y_max = area.lines
    x, y = area.x + _CENTRE_CIRCLE * np.cos(corners), area.y + _CENTRE_CIRCLE * np.sin(corners)
    return [(area.x, y_min), (area.x, y_max)], list(zip(x.tolist(), y.tolist(), strict=True))
