"""The scene around a robot: the area, the objects that roll in it, and its bays."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from ator_ros.geometry import Pose
from ator_ros.schema import NAME, Within
from ator_ros.world.readers import FARTHEST
from ator_ros.world.state import AT_REST, ObjectState

WALL_THICKNESS = 0.05
"""Thickness in m of the walls of a bay."""

# Contacts of bodies below 1 mm or above 10 m are beyond the solver's step of 1/240 s.
Size = Annotated[float, Within(0.001, 10.0)]
Extent = Annotated[float, Within(0.001, 100_000.0)]
"""Sizes of areas in m: a robot at 15 m/s drives 900 m in a minute."""
Place = Annotated[float, Within(-FARTHEST, FARTHEST)]
Mass = Annotated[float, Within(0.001, 10_000.0)]
"""In kg, from 1 g to 10 t: beyond is a wrong unit."""


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle in the frame of odometry, in m."""

    length: Extent  # along x
    width: Extent  # along y
    margin: Extent  # free floor around it
    x: Place = 0.0  # of its center
    y: Place = 0.0

    @property
    def lines(self) -> tuple[float, float, float, float]:
        """Edges x_min, y_min, x_max, y_max in m."""
        return self._edges(0.0)

    @property
    def floor(self) -> tuple[float, float, float, float]:
        """Edges x_min, y_min, x_max, y_max in m of the area with its margin."""
        return self._edges(self.margin)

    def _edges(self, margin: float) -> tuple[float, float, float, float]:
        x = self.length / 2 + margin
        y = self.width / 2 + margin
        return self.x - x, self.y - y, self.x + x, self.y + y

    def has_floor(self, x: float, y: float) -> bool:
        """Return whether (x, y) in m lies on the area or its margin."""
        x_min, y_min, x_max, y_max = self.floor
        return x_min <= x <= x_max and y_min <= y <= y_max

    def at(
        self,
        x: float,
        y: float,
        yaw: float = 0.0,
    ) -> Pose:
        """Return the pose that lies (x, y) m from the center, with heading `yaw` in rad."""
        return Pose(self.x + x, self.y + y, yaw)


@dataclass(frozen=True, slots=True)
class RoundObject:
    """A hollow sphere: radius in m, mass in kg, deceleration in m/s^2 as it rolls, restitution."""

    radius: Size
    mass: Mass
    # At 0.001 m/s^2 an object of 0.3 m/s rolls for 5 min; 100 is 10 g. Restitution is a share.
    rolling_deceleration: Annotated[float, Within(0.001, 100.0)]
    restitution: Annotated[float, Within(0.0, 1.0)]

    def at_rest(self, state: ObjectState) -> ObjectState:
        """Return the state in which the object comes to rest by itself."""
        if AT_REST.holds(state.speed):
            return state
        seconds = state.speed / (2.0 * self.rolling_deceleration)
        return ObjectState(state.x + state.vx * seconds, state.y + state.vy * seconds)


@dataclass(frozen=True, slots=True)
class Bay:
    """Three walls around an open front, such as a dock or a goal."""

    x: Place  # m; middle of the front
    y: Place
    # rad; into the bay. Greater values are degrees
    yaw: Annotated[float, Within(-math.tau, math.tau)]
    width: Extent  # m; inner sizes
    depth: Extent


@dataclass(frozen=True, slots=True)
class Scene:
    """The surroundings of the robot."""

    area: Area  # where the robot is meant to drive
    objects: Mapping[Annotated[str, NAME], RoundObject] = field(default_factory=dict, hash=False)
    bays: tuple[Bay, ...] = ()

    def radius(self, name: str) -> float:
        """Return the radius of an object in m; 0 if it is not described."""
        return self.objects[name].radius if name in self.objects else 0.0

    def at_rest(self, name: str, state: ObjectState) -> ObjectState:
        """Return the state in which an object comes to rest.

        One without a description does not move.
        """
        return self.objects[name].at_rest(state) if name in self.objects else state
