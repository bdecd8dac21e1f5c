"""Situations as data: the places, drives and chains that a domain's file draws to learn and to measure in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.situation import NoPlaceError, Situation, drawn_until, short_goal
from ator_ros.files import is_name
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.schema import require
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.messages import FARTHEST
from ator_ros.world.state import RobotState, World

T = TypeVar("T")

_MOST_STEPS = 32  # as many as refinement accepts
_MOST_PLACES = 1000
"""Draws of one place before all places of a drive or a chain are drawn again."""
_MOST_SEQUENCES = 100
"""Draws of all places of a drive or a chain."""
_BESIDE = 0.05
_ALL_ROUND = (-math.pi, math.pi)


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
            _check_spread(name, getattr(self, name), FARTHEST)
        _check_spread("yaw", self.yaw, math.tau)

    @property
    def is_fixed(self) -> bool:
        """Whether x and y are numbers."""
        return len(self.x) == len(self.y) == 1

    def contains(self, pose: Pose) -> bool:
        """Return whether a position lies in the place, or beside it by up to `_BESIDE` m."""
        return all(
            spread[0] - _BESIDE <= value <= spread[-1] + _BESIDE
            for value, spread in ((pose.x, self.x), (pose.y, self.y))
        )

    def drawn(self, rng: np.random.Generator) -> Pose:
        """Draw a pose."""
        return Pose(*(float(rng.uniform(spread[0], spread[-1])) for spread in (self.x, self.y, self.yaw)))


Places = tuple[DeclaredPlace, ...]


def _is_fixed(places: Places) -> bool:
    return len(places) == 1 and places[0].is_fixed


def _check_places(name: str, places: Places) -> None:
    require(bool(places), name, "at least one place", list(places))


def _check_apart(apart: float) -> None:
    require(0.0 <= apart <= FARTHEST, "apart", f"a distance in m from 0 to {FARTHEST:g}", apart)


def _drawn(
    places: Places, rng: np.random.Generator, *, apart: float = 0.0, before: Pose | None = None
) -> Pose:
    """Draw a pose of one of the places, at least `apart` m from the pose `before`; raises NoPlaceError."""
    return drawn_until(
        lambda: places[int(rng.integers(len(places)))].drawn(rng),
        lambda pose: before is None or pose.distance(before) >= apart,
        lambda: f"apart: expected places {apart:g} m from the one before",
        most=1 if _is_fixed(places) else _MOST_PLACES,
    )


def _drawn_again(draw: Callable[[], T]) -> T:
    """Draw all places of a drive or a chain, again while one of them is too near the one before.

    A place may be fixed, or too small for all that can precede it: then the one before must move.
    """
    for _ in range(_MOST_SEQUENCES - 1):
        with suppress(NoPlaceError):
            return draw()
    return draw()


@contextmanager
def _naming(where: str) -> Iterator[None]:
    """Say of which entry of the file it was that a place was missing."""
    try:
        yield
    except NoPlaceError as error:
        raise NoPlaceError(f"{where}: {error}") from None


def _too_far(robot: Robot, time_limit: float) -> str:
    """Return in words what a way was expected to be that is driven in time."""
    most = robot.limits.v * time_limit
    return (
        f"expected a way of {most:.2f} m at most, which robot {robot.name} drives at {robot.limits.v:g} m/s "
        f"in the {time_limit:g} s of time_limit"
    )


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
        """Draw start and destination of a drive; raises NoPlaceError."""
        start = _drawn(self.start, rng)
        return start, _drawn(self.goal, rng, apart=self.apart, before=start)

    def contains(self, pose: Pose) -> bool:
        """Return whether a position lies in one of the places."""
        return any(place.contains(pose) for place in (*self.start, *self.goal))


def drawn_drive(
    action: str,
    drives: DeclaredDrives,
    point: Point,
    variables: tuple[GoalVariable, ...],
    robot: Robot,
    rng: np.random.Generator,
    *,
    time_limit: float,
) -> Situation:
    """Draw a drive of an action, in one of seven cases with a goal near its start; see `ActionSpec.sample`.

    None is drawn that takes longer than `time_limit` (s) straight ahead at full speed. Goal variables that
    the action declares are drawn evenly from their ranges.

    Raises
    ------
    NoPlaceError
        There is no such drive.
    """
    most = robot.limits.v * time_limit
    with _naming(f"drives of {action}"):
        start, destination = drawn_until(
            lambda: _drawn_again(lambda: drives.drawn(rng)),
            lambda way: way[0].distance(way[1]) <= most,
            lambda: _too_far(robot, time_limit),
        )
    short = short_goal(start, rng)
    if short is not None and drives.contains(short):
        destination = short
    values = {item.name: float(rng.uniform(item.low, item.high)) for item in variables}
    return Situation(action, RobotState(start), {}, Goal(destination, 0.0, point, values))


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
    """Random chains: where the robot starts, and the steps, each at least `apart` m from the one before.

    Two fixed places that follow each other may be nearer.
    """

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

    def drawn(self, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
        """Draw a situation and a chain; raises NoPlaceError."""
        before = start = _drawn(self.start, rng)
        was_fixed = _is_fixed(self.start)
        calls: list[TopCall] = []
        for step in self.steps:
            is_fixed = _is_fixed(step.goal)
            for _ in range(int(rng.integers(step.times[0], step.times[-1] + 1))):
                apart = 0.0 if was_fixed and is_fixed else self.apart
                before, was_fixed = _drawn(step.goal, rng, apart=apart, before=before), is_fixed
                top = library[step.top]
                calls.append(TopCall(top, library.goal(top, before), frozenset(step.open)))
        return World(0.0, RobotState(start)), TopChain(tuple(calls))


def drawn_chain(
    chain: DeclaredChain,
    robot: Robot,
    library: TopLibrary,
    rng: np.random.Generator,
    *,
    time_limit: float,
) -> tuple[World, TopChain]:
    """Draw a situation and a chain whose straight ways take at most `time_limit` (s) at full speed.

    Raises
    ------
    NoPlaceError
        There is none.
    """
    with _naming(f"chain {chain.name}"):
        return drawn_until(
            lambda: _drawn_again(lambda: chain.drawn(library, rng)),
            lambda drawn: _length(*drawn) <= robot.limits.v * time_limit,
            lambda: _too_far(robot, time_limit),
        )


def _length(world: World, chain: TopChain) -> float:
    """Return the length in m of the straight ways from step to step."""
    places = [world.robot.pose, *(call.goal.pose for call in chain.calls)]
    return sum(one.distance(other) for one, other in itertools.pairwise(places))
