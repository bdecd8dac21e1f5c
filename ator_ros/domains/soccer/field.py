"""The soccer field: the area of the scene, with two goals."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.domains.soccer.ball import BALL
from ator_ros.geometry import Pose
from ator_ros.robot.description import ConfigError, Robot
from ator_ros.world.scene import Bay, Scene
from ator_ros.world.state import ObjectState


@dataclass(frozen=True, slots=True)
class Field:
    """The field, centred on the origin, its goals on the lines x = -length/2 and x = length/2.

    Attributes
    ----------
    length, width : float
        Between the lines, in m.
    goal_width, goal_depth : float
        Inner sizes of both goals in m; 0 where there are none.
    """

    length: float
    width: float
    goal_width: float
    goal_depth: float

    @property
    def walls_begin(self) -> float:
        """The |x| in m beyond which walls of the goals stand; infinite without goals."""
        return self.length / 2 if self.goal_depth else math.inf

    def goal_centre(self, side: int = 1) -> tuple[float, float]:
        """Return the middle of the goal line of the goal at x > 0 (side 1) or x < 0 (side -1), in m."""
        return side * self.length / 2.0, 0.0


def field_of(robot: Robot) -> Field:
    """Return the field of a robot's scene, which `goals_in` has checked, or which has no goals."""
    area, bays = robot.scene.area, robot.scene.bays
    width, depth = (bays[0].width, bays[0].depth) if bays else (0.0, 0.0)
    return Field(area.length, area.width, width, depth)


def behind_line(ball: ObjectState, mouth: Pose) -> float:
    """Return how far in m a ball's centre lies behind the goal line of `mouth`; negative before it."""
    return (ball.x - mouth.x) * math.copysign(1.0, mouth.x)


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
        The width of the goals.
    beyond : float
        How far in m the ball's centre must lie behind the line; its radius, if the whole ball must.
    """
    return behind_line(ball, mouth) > beyond and abs(ball.y - mouth.y) < field.goal_width / 2


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
    half = scene.area.length / 2
    sizes = {(bay.width, bay.depth) for bay in scene.bays}
    places = sorted((bay.x, bay.y, round(abs(bay.yaw), 6)) for bay in scene.bays)
    if scene.bays and (len(sizes) > 1 or places != [(-half, 0.0, round(math.pi, 6)), (half, 0.0, 0.0)]):
        raise ConfigError(
            f"scene.bays: expected two equal goals on the lines x = {-half:g} and x = {half:g}, opening to "
            f"the middle, or none, got {list(scene.bays)}"
        )
    return scene.bays
