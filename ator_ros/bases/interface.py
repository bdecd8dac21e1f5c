"""What other rooms need to know of how a robot moves: the interface of a base."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.world.state import Command, RobotState

if TYPE_CHECKING:
    import pandas as pd

Place = tuple[float, float]
"""x and y in m."""


@dataclass(frozen=True, slots=True)
class Axis:
    """A component of the velocity that a base controls.

    Attributes
    ----------
    name : str
        The field of `Command` and of `RobotState` that holds it.
    verb : str
        What a base does that has such a velocity, for messages: "move" or "turn".
    unit : str
        Unit of the velocity.
    limit : float
        Greatest velocity.
    backward : float
        Greatest velocity in the negative direction, as a positive number.
    rate : float
        Least change of velocity per s by which the base follows commands.
    stop : float
        Least change of velocity per s after a command to stop.
    """

    name: str
    verb: str
    unit: str
    limit: float
    backward: float
    rate: float
    stop: float


class Standstills(NamedTuple):
    """Where a robot in motion may come to stand.

    Attributes
    ----------
    commanded : Place
        After a command to stop.
    braking : tuple of sequence of Place
        Paths that an action may take which brakes to a standstill: of each the middle and the end.
    """

    commanded: Place
    braking: tuple[Sequence[Place], ...]


@dataclass(frozen=True)
class Driving:
    """How an action drives a base, as far as odometry and durations show it.

    Model files hold the fields of the subclass that a base uses. This class itself has none: an
    action drives like the base.
    """

    quantities: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Names and units of quantities of drives, beside those of any base, that features may be."""

    @property
    def uses_quantities(self) -> bool:
        """Whether the quantities are features of durations, for an action that drives like this."""
        return False

    def values(self, dist: FloatArray, to: FloatArray, at: FloatArray) -> FloatArray:
        """Return the quantities of n drives, shape (len(quantities), n).

        `dist` is the distance in m, `to` and `at` are the sizes in rad of the angles to the
        destination and at it, all of shape (n,).
        """
        del to, at
        return np.empty((0, len(dist)))

    def rule(self) -> str:
        """Return the sentence that readers of rules with these quantities need; may be empty."""
        return ""


class Base(ABC):
    """How a robot moves. Velocities are planar vectors with a turn rate, in the robot's frame."""

    __slots__ = ()

    driving: ClassVar[type[Driving]] = Driving
    """The dataclass of what is learned of an action's driving."""

    @property
    @abstractmethod
    def axes(self) -> tuple[Axis, ...]:
        """The components of the velocity that the base controls."""

    @property
    @abstractmethod
    def lag(self) -> float:
        """Time constant in s with which the base follows its commands."""

    @abstractmethod
    def greatest_speed(self, *, holding: bool = False) -> float:
        """Return the greatest speed in m/s, with or without an object in the holder.

        Raises ConfigError if it is asked for holding, and the robot has no holder.
        """

    @property
    def greatest_turn_rate(self) -> float:
        """In rad/s; 0 if the base never turns."""
        return max((axis.limit for axis in self.axes if axis.name == "w"), default=0.0)

    @property
    def moves_sideways(self) -> bool:
        """Whether the base controls its lateral velocity, which is 0 otherwise."""
        return any(axis.name == "vy" for axis in self.axes)

    @abstractmethod
    def moved(self, robot: RobotState, command: Command | None, seconds: float) -> RobotState:
        """Return the state after `seconds` under one command; None: at constant velocity."""

    @abstractmethod
    def stopping_distance(self, speed: float) -> float:
        """Return the distance in m in which the base surely stops from a `speed` in m/s."""

    @abstractmethod
    def standstills(self, robot: RobotState, seconds: float) -> Standstills:
        """Return where a robot may stand that keeps its velocity for `seconds` before it brakes."""

    def unobserved_driving(self) -> Driving:
        """Return how an action is assumed to drive that was not observed: at all limits."""
        return Driving()

    def observed_driving(self, rows: pd.DataFrame) -> Driving:
        """Return how an action drives, by its rows in an experience table.

        Where too little was observed, it is assumed to drive as an unobserved one.
        """
        del rows
        return self.unobserved_driving()

    def completed_driving(self, driving: Driving, starts: pd.DataFrame) -> Driving:
        """Return `driving` with what the starts of episodes show and `driving` leaves open."""
        del starts
        return driving

    @abstractmethod
    def fastest(self, legs: FloatArray, driving: Driving | None) -> FloatArray:
        """Return times (s) and angles turned (rad) of the fastest motions, shape (2, n).

        `legs` are the direct variables of n drives, a row for each of `DIRECT_VARIABLES`. The
        motions are as the action was observed to drive; None: as an unobserved action.
        """

    @abstractmethod
    def route_time(
        self,
        length: FloatArray,
        turns: Sequence[FloatArray],
        speed: FloatArray,
        arrival_speed: FloatArray,
    ) -> FloatArray:
        """Return the least times in s for routes on a map, shape (n,).

        `length` is in m, the speeds at both ends are in m/s. `turns` are the angles in rad to turn
        at the start, at the bends in sum, and at the goal. All have the shape (n,).
        """

    @abstractmethod
    def draw_velocity(self, rng: np.random.Generator) -> Command:
        """Draw a velocity that the base may have while it drives."""
