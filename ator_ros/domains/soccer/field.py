"""The soccer field and its ball.

The field is the area of the scene, with two goals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.situation import Situation
from ator_ros.bases.description import ConfigError, Robot
from ator_ros.domains.domain import Line
from ator_ros.geometry import Pose
from ator_ros.world.scene import Bay, Scene
from ator_ros.world.state import ObjectState, World

BALL = "ball"
"""Name of the ball among the objects of a world and in conditions."""


def ball_of(world: World | Situation) -> ObjectState | None:
    """Return the ball of a world or of a situation; None if there is none."""
    return world.objects.get(BALL)


def objects_of(ball: ObjectState | None) -> dict[str, ObjectState]:
    """Return the objects of a world that contains `ball`, or nothing."""
    return {} if ball is None else {BALL: ball}


_MISPLACED = 1e-5  # m and rad: greatest error of a goal's pose
_CENTER_CIRCLE = 1.0  # m, radius


@dataclass(frozen=True, slots=True)
class Field:
    """The field in m; its goals are on the two lines at right angles to the x axis.

    Attributes
    ----------
    length, width : float
        Distances between the lines, along x and y.
    goal_width, goal_depth : float
        Inner sizes of both goals; 0 without goals.
    x, y : float
        Center of the field.
    """

    length: float
    width: float
    goal_width: float
    goal_depth: float
    x: float = 0.0
    y: float = 0.0

    def goal_center(self, side: int = 1) -> tuple[float, float]:
        """Return the middle of a goal line: x and y in m.

        Side 1 is the goal at greater x, side -1 the other one.
        """
        return self.x + side * self.length / 2.0, self.y

    def side_of(self, x: float) -> int:
        """Return the side of x (m): 1 for greater x than the center's, -1 otherwise."""
        return 1 if x > self.x else -1


def field_of(robot: Robot) -> Field:
    """Return the field of a robot's scene, which `field_in` has checked."""
    area = robot.scene.area
    bays = robot.scene.bays
    width, depth = (bays[0].width, bays[0].depth) if bays else (0.0, 0.0)
    return Field(
        area.length,
        area.width,
        width,
        depth,
        area.x,
        area.y,
    )


def behind_line(ball: ObjectState, mouth: Pose, field: Field) -> float:
    """Return the distance in m of a ball's center behind the goal line; negative before it.

    `mouth` is the middle of the goal line.
    """
    return (ball.x - mouth.x) * field.side_of(mouth.x)


def is_in_goal(
    ball: ObjectState,
    mouth: Pose,
    field: Field,
    beyond: float,
) -> bool:
    """Return whether the ball lies in the goal, more than `beyond` m behind the goal line.

    `mouth` is the middle of the goal line.
    """
    between_posts = abs(ball.y - mouth.y) < field.goal_width / 2
    return behind_line(ball, mouth, field) > beyond and between_posts


def field_in(scene: Scene) -> tuple[Bay, ...]:
    """Return the bays of a scene: two equal goals on the lines, or none.

    Raises
    ------
    ConfigError
        There is no ball, whose radius and mass the actions need, or the bays are no two equal
        goals.
    """
    if BALL not in scene.objects:
        raise ConfigError(
            f"scene.objects: expected {BALL!r} among them, got {sorted(scene.objects)}"
        )
    left, _, right, _ = scene.area.lines
    middle = scene.area.y
    goals = [(left, middle, math.pi), (right, middle, 0.0)]
    sizes = {(bay.width, bay.depth) for bay in scene.bays}
    poses = sorted((bay.x, bay.y, abs(bay.yaw)) for bay in scene.bays)
    placed = len(poses) == 2
    if placed:
        errors = [math.dist(pose, goal) for pose, goal in zip(poses, goals, strict=True)]
        placed = all(error < _MISPLACED for error in errors)
    if scene.bays and (len(sizes) > 1 or not placed):
        raise ConfigError(
            f"scene.bays: expected two equal goals on the lines x = {left:.10g} and "
            f"x = {right:.10g} at y = {middle:.10g}, opening to the middle, or none, "
            f"got {list(scene.bays)}"
        )
    return scene.bays


def field_lines(robot: Robot) -> Sequence[Line]:
    """Return the halfway line and the center circle, as places (x, y) in m."""
    area = robot.scene.area
    corners = np.linspace(0.0, 2.0 * np.pi, 49)
    _, y_min, _, y_max = area.lines
    x = area.x + _CENTER_CIRCLE * np.cos(corners)
    y = area.y + _CENTER_CIRCLE * np.sin(corners)
    halfway = [(area.x, y_min), (area.x, y_max)]
    circle = list(zip(x.tolist(), y.tolist(), strict=True))
    return halfway, circle
