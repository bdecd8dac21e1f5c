"""Situations as data: the places, drives and chains that a domain's file draws to learn and to measure in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.situation import Situation
from ator_ros.files import is_name
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.schema import require
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import RobotState, World

_MOST_STEPS = 32
_MOST_DRAWS = 10_000
_FARTHEST = 1000.0
_ALL_ROUND = (-math.pi, math.pi)


class NoPlaceError(ValueError):
    """Places of which none lies as far from the one before as was declared."""


def _check_spread(name: str, spread: tuple[float, ...], most: float) -> None:
    good = len(spread) in (1, 2) and list(spread) == sorted(spread) and max(map(abs, spread)) <= most
    require(good, name, f"[a number] or [least, greatest], none beyond {most:g}", list(spread))


@dataclass(frozen=True, slots=True)
class DeclaredPlace:
    """A pose (m, rad): each coordinate a number, or a range from which it is drawn evenly."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    yaw: tuple[float, ...] = _ALL_ROUND

    def __post_init__(self) -> None:
        """Check that all are numbers or ranges."""
        for name in ("x", "y"):
            _check_spread(name, getattr(self, name), _FARTHEST)
        _check_spread("yaw", self.yaw, math.tau)

    def drawn(self, rng: np.random.Generator) -> Pose:
        """Draw a pose."""
        return Pose(*(float(rng.uniform(spread[0], spread[-1])) for spread in (self.x, self.y, self.yaw)))


Places = tuple[DeclaredPlace, ...]


def _check_places(name: str, places: Places) -> None:
    require(bool(places), name, "at least one place", list(places))


def _check_apart(apart: float) -> None:
    require(0.0 <= apart <= _FARTHEST, "apart", f"a distance in m from 0 to {_FARTHEST:g}", apart)


def _drawn(
    places: Places, rng: np.random.Generator, *, apart: float = 0.0, before: Pose | None = None
) -> Pose:
    """Draw a pose of one of the places, at least `apart` m from the pose `before`; raises NoPlaceError."""
    for _ in range(_MOST_DRAWS):
        pose = places[int(rng.integers(len(places)))].drawn(rng)
        if before is None or pose.distance(before) >= apart:
            return pose
    raise NoPlaceError(f"apart: expected places {apart:g} m from the one before, found none")


@dataclass(frozen=True, slots=True)
class DeclaredDrives:
    """Where drives of an action begin and lead, to gather experience: from rest, at least `apart` m."""

    start: Places
    goal: Places
    apart: float = 0.5

    def __post_init__(self) -> None:
        """Check that there are places."""
        _check_places("start", self.start)
        _check_places("goal", self.goal)
        _check_apart(self.apart)

    def drawn(self, rng: np.random.Generator) -> tuple[Pose, Pose]:
        """Draw start and destination of a drive."""
        start = _drawn(self.start, rng)
        return start, _drawn(self.goal, rng, apart=self.apart, before=start)


@dataclass(frozen=True, slots=True)
class DrivesOf:
    """The sampler of an action's drives, see `ActionSpec.sample`.

    Attributes
    ----------
    action : str
        Name of the action.
    drives : DeclaredDrives
        Where they begin and lead.
    point : Point
        Reference point of the robot that comes to the destination.
    variables : tuple of GoalVariable
        Goal variables that the action declares; each is drawn evenly from its range.
    """

    action: str
    drives: DeclaredDrives
    point: Point = Point.AXLE
    variables: tuple[GoalVariable, ...] = ()

    def __call__(self, robot: Robot, rng: np.random.Generator) -> Situation:  # noqa: ARG002
        """Draw a drive."""
        start, destination = self.drives.drawn(rng)
        values = {item.name: float(rng.uniform(item.low, item.high)) for item in self.variables}
        return Situation(self.action, RobotState(start), {}, Goal(destination, 0.0, self.point, values))


@dataclass(frozen=True, slots=True)
class DeclaredStep:
    """Steps of a chain: their TOP, where they lead, and what they leave open.

    Attributes
    ----------
    top : str
        Name of the TOP.
    goal : tuple of DeclaredPlace
        One of which is drawn for each step.
    open : tuple of str
        Goal variables that refinement may change.
    times : tuple of int
        How many such steps follow each other: a number, or the least and the greatest.
    """

    top: str
    goal: Places
    open: tuple[str, ...] = ()
    times: tuple[int, ...] = (1,)

    def __post_init__(self) -> None:
        """Check places and numbers."""
        _check_places("goal", self.goal)
        times = self.times
        good = len(times) in (1, 2) and 0 <= times[0] <= times[-1] and 1 <= times[-1] <= _MOST_STEPS
        require(good, "times", f"[a number] or [least, greatest] from 0 to {_MOST_STEPS}", list(times))


@dataclass(frozen=True, slots=True)
class DeclaredChain:
    """Random chains: where the robot starts, and the steps, each at least `apart` m from the one before."""

    name: str
    start: Places
    steps: tuple[DeclaredStep, ...]
    apart: float = 0.5

    def __post_init__(self) -> None:
        """Check name, places and the number of steps."""
        require(is_name(self.name), "name", "a name of letters, digits and _", self.name)
        _check_places("start", self.start)
        _check_apart(self.apart)
        least, most = (sum(step.times[end] for step in self.steps) for end in (0, -1))
        require(least >= 1 and most <= _MOST_STEPS, "steps", f"1 to {_MOST_STEPS} of them", (least, most))

    def check(self, tops: tuple[str, ...]) -> None:
        """Make sure that the steps name TOPs that there are; raises ValueError."""
        for number, step in enumerate(self.steps):
            require(step.top in tops, f"steps[{number}].top", f"one of {', '.join(tops)}", step.top)

    def __call__(
        self,
        robot: Robot,  # noqa: ARG002
        library: TopLibrary,
        rng: np.random.Generator,
    ) -> tuple[World, TopChain]:
        """Draw a situation and a chain, as a `ChainSampler` does."""
        before = start = _drawn(self.start, rng)
        calls: list[TopCall] = []
        for step in self.steps:
            for _ in range(int(rng.integers(step.times[0], step.times[-1] + 1))):
                before = _drawn(step.goal, rng, apart=self.apart, before=before)
                top = library[step.top]
                calls.append(TopCall(top, library.goal(top, before), frozenset(step.open)))
        return World(0.0, RobotState(start)), TopChain(tuple(calls))
