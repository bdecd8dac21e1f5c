"""The estimated state of the world at one time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ator_ros.geometry import Pose, as_float, decimal_pose


@dataclass(frozen=True, slots=True)
class Command:
    """A velocity command, the output of actions, in the robot's frame (REP 103)."""

    vx: float = 0.0  # m/s; positive forward
    vy: float = field(default=0.0, kw_only=True)  # m/s; positive to the left
    w: float = 0.0  # rad/s; positive counter-clockwise


STOP = Command()

CONTROL_PERIOD = 0.05
"""Time in s between two states and so between two commands: a control tick."""


@dataclass(frozen=True, slots=True)
class Standstill:
    """Speeds up to which a robot or an object counts as standing still, one for each use."""

    speed: float  # m/s
    w: float = math.inf  # rad/s; infinite if turning does not matter

    def holds(self, speed: Any, w: Any = 0.0) -> Any:
        """Return whether a speed (m/s) and a turn rate (rad/s), of any sign, are a standstill.

        Elementwise.
        """
        return (abs(speed) <= self.speed) & (abs(w) <= self.w)


AT_REST = Standstill(0.001)
"""An object that was placed, or described, at rest; measured speeds are rarely 0."""
STILL = Standstill(0.003, 0.006)
"""A robot that stands, up to the noise of its odometry: a plan may begin there, and wait."""
STANDING = Standstill(0.02, 0.05)
"""A robot that has stopped: its goal may end, and another program may move it."""
RESTING = Standstill(0.02)
"""An object that rolls less far than its position is uncertain."""


@dataclass(frozen=True, slots=True)
class RobotState:
    """Pose of the robot in the world frame, and its velocity in its own frame (REP 103).

    With two driven wheels the pose is that of the middle of the axle, and `vy` is 0.
    """

    pose: Pose
    vx: float = 0.0  # m/s; positive forward
    vy: float = field(default=0.0, kw_only=True)  # m/s; positive to the left
    w: float = 0.0  # rad/s; positive counter-clockwise

    def __post_init__(self) -> None:
        """Read whole numbers as floats; states are created at a high rate, with floats only."""
        x, y, yaw = self.pose
        vx = self.vx
        vy = self.vy
        w = self.w
        if type(x) is type(y) is type(yaw) is type(vx) is type(vy) is type(w) is float:
            return
        object.__setattr__(self, "pose", decimal_pose(self.pose))
        for name in ("vx", "vy", "w"):
            object.__setattr__(self, name, as_float(getattr(self, name)))

    @property
    def velocity(self) -> Command:
        """The velocity, as a command that keeps it."""
        return Command(self.vx, self.w, vy=self.vy)

    @property
    def speed(self) -> float:
        """In m/s, whatever the direction."""
        return math.hypot(self.vx, self.vy)

    @property
    def is_still(self) -> bool:
        """Whether the robot is still, see `STILL`; stricter than `is_standing`."""
        return bool(STILL.holds(self.speed, self.w))

    @property
    def is_standing(self) -> bool:
        """Whether the robot stands, see `STANDING`."""
        return bool(STANDING.holds(self.speed, self.w))


@dataclass(frozen=True, slots=True)
class ObjectState:
    """Position (m) and velocity (m/s) of an object's center in the world frame."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0

    def __post_init__(self) -> None:
        """Read whole numbers as floats; see `RobotState`."""
        if type(self.x) is type(self.y) is type(self.vx) is type(self.vy) is float:
            return
        for name in ("x", "y", "vx", "vy"):
            object.__setattr__(self, name, as_float(getattr(self, name)))

    @property
    def speed(self) -> float:
        """In m/s."""
        return math.hypot(self.vx, self.vy)

    @property
    def is_resting(self) -> bool:
        """Whether the object rests, see `RESTING`."""
        return bool(RESTING.holds(self.speed))

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
