"""The estimated state of the world at one time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ator_ros.geometry import Pose


@dataclass(frozen=True, slots=True)
class Command:
    """A velocity command, the output of actions.

    Attributes
    ----------
    v : float
        Translational velocity in m/s, positive forward.
    w : float
        Rotational velocity in rad/s, positive counter-clockwise.
    """

    v: float = 0.0
    w: float = 0.0


STOP = Command()

CONTROL_PERIOD = 0.05
"""Time in s between two states, and so between two commands: a control tick."""


@dataclass(frozen=True, slots=True)
class RobotState:
    """Pose of the middle of the axle in the world frame, with its velocities (m/s, rad/s)."""

    pose: Pose
    v: float = 0.0
    w: float = 0.0

    @property
    def is_still(self) -> bool:
        """Whether the robot is at rest: at most 0.003 m/s and 0.006 rad/s, stricter than `is_standing`."""
        return abs(self.v) <= 0.003 and abs(self.w) <= 0.006

    @property
    def is_standing(self) -> bool:
        """Whether the robot counts as standing: slower than 0.02 m/s and 0.05 rad/s."""
        return abs(self.v) < 0.02 and abs(self.w) < 0.05


@dataclass(frozen=True, slots=True)
class ObjectState:
    """Position (m) and velocity (m/s) of an object's centre in the world frame."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0

    @property
    def speed(self) -> float:
        """Speed in m/s."""
        return math.hypot(self.vx, self.vy)

    @property
    def rests(self) -> bool:
        """Whether the object counts as resting: slower than 0.02 m/s."""
        return self.speed < 0.02

    def after(self, seconds: float) -> ObjectState:
        """Return the state extrapolated at constant velocity; `seconds` may be negative."""
        return dataclasses.replace(self, x=self.x + seconds * self.vx, y=self.y + seconds * self.vy)


@dataclass(frozen=True, slots=True)
class World:
    """The estimated state: time in s, robot, and the known objects by name."""

    time: float
    robot: RobotState
    objects: Mapping[str, ObjectState] = field(default_factory=dict, hash=False)

    def with_object(self, name: str, state: ObjectState) -> World:
        """Return the world with one object added or replaced."""
        return dataclasses.replace(self, objects={**self.objects, name: state})
