"""Schema of a domain's YAML file (docs/remote_actions.md): parts, random drives and chains."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
import shlex
from collections.abc import Callable
from contextlib import suppress
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np

from ator_ros.actions import DEFAULT_SET, TIME_LIMIT
from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import STOP, STOPS, GoalVariable, drawn_values
from ator_ros.actions.remote import Duration, RemoteCall
from ator_ros.actions.situation import NoPlaceError, Situation, drawn_until, short_goal
from ator_ros.bases.description import Robot
from ator_ros.files import is_name
from ator_ros.geometry import Pose
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.schema import NAME, NOT_EMPTY, Within, require
from ator_ros.tops.chain import AllowedRange, Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Region, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.ranges import USUAL_RANGES, Range
from ator_ros.world.readers import FARTHEST, ObjectSource
from ator_ros.world.state import RobotState, World

T = TypeVar("T")

_MOST_PLACES = 1000  # draws of one place before all places of a drive or a chain are drawn again
_MOST_SEQUENCES = 100  # draws of all places of a drive or a chain
_BESIDE = 0.05  # m
_ALL_ROUND = (-math.pi, math.pi)


@dataclass(frozen=True, slots=True)
class DeclaredPlace:
    """A pose (m, rad): each coordinate is a number, or a range from which it is drawn evenly."""

    x: tuple[float, ...]
    y: tuple[float, ...]
    yaw: tuple[float, ...] = _ALL_ROUND

    def __post_init__(self) -> None:
        for name, most in (("x", FARTHEST), ("y", FARTHEST), ("yaw", math.tau)):
            spread = list(getattr(self, name))
            good = (
                len(spread) in (1, 2) and spread == sorted(spread) and max(map(abs, spread)) <= most
            )
            require(good, name, f"[a number] or [least, greatest], none beyond {most:g}", spread)

    def contains(self, pose: Pose) -> bool:
        """Return whether a position lies in the place, or up to `_BESIDE` from it."""
        return all(
            spread[0] - _BESIDE <= value <= spread[-1] + _BESIDE
            for value, spread in ((pose.x, self.x), (pose.y, self.y))
        )

    def drawn(self, rng: np.random.Generator) -> Pose:
        """Draw a pose."""
        return Pose(
            *(float(rng.uniform(spread[0], spread[-1])) for spread in (self.x, self.y, self.yaw))
        )


Places = Annotated[tuple[DeclaredPlace, ...], NOT_EMPTY]
Apart = Annotated[float, Within(0.0, FARTHEST)]
"""A distance in m."""


def _is_fixed(places: Places) -> bool:
    """Return whether there is only one position to draw."""
    return len(places) == len(places[0].x) == len(places[0].y) == 1


def _drawn(
    places: Places, rng: np.random.Generator, *, apart: float = 0.0, before: Pose | None = None
) -> Pose:
    """Draw a pose of one of the places, at least `apart` m from the pose `before`.

    Raises NoPlaceError.
    """
    return drawn_until(
        lambda: places[int(rng.integers(len(places)))].drawn(rng),
        lambda pose: before is None or pose.distance(before) >= apart,
        lambda: f"apart: expected places {apart:g} m from the one before",
        most=1 if _is_fixed(places) else _MOST_PLACES,
    )


def _drawn_in_time(
    where: str, draw: Callable[[], T], length: Callable[[T], float], robot: Robot, time_limit: float
) -> T:
    """Draw a drive or a chain that takes at most `time_limit` (s) straight ahead at full speed."""
    most = robot.greatest_speed() * time_limit

    def drawn() -> T:
        # A place may be fixed, or too small for some places before it: then all are drawn again.
        for _ in range(_MOST_SEQUENCES - 1):
            with suppress(NoPlaceError):
                return draw()
        return draw()

    try:
        return drawn_until(
            drawn,
            lambda found: length(found) <= most,
            lambda: (
                f"expected a path of {most:.2f} m at most, which robot {robot.name} drives at "
                f"{robot.greatest_speed():g} m/s in the {time_limit:g} s of time_limit"
            ),
        )
    except NoPlaceError as error:
        raise NoPlaceError(f"{where}: {error}") from None


@dataclass(frozen=True, slots=True)
class DeclaredDrives:
    """Starts and goals of drives that give an action experience: from rest, at least `apart` m."""

    start: Places
    goal: Places
    apart: Apart = 0.5

    def sample(
        self,
        action: str,
        point: Point,
        variables: tuple[GoalVariable, ...],
        robot: Robot,
        rng: np.random.Generator,
        *,
        time_limit: float,
    ) -> Situation:
        """Draw a drive that takes at most `time_limit` (s) straight ahead at full speed.

        In one of seven cases the goal is near the start. Goal variables that the action declares
        are drawn evenly from their ranges.

        Raises
        ------
        NoPlaceError
            There is no such drive.
        """

        def drawn() -> tuple[Pose, Pose]:
            start = _drawn(self.start, rng)
            return start, _drawn(self.goal, rng, apart=self.apart, before=start)

        where = f"drives of {action}"
        start, goal = _drawn_in_time(
            where, drawn, lambda ends: ends[0].distance(ends[1]), robot, time_limit
        )
        short = short_goal(start, rng)
        if short is not None and any(place.contains(short) for place in (*self.start, *self.goal)):
            goal = short
        values = drawn_values(variables, rng)
        return Situation(action, RobotState(start), {}, Goal(goal, 0.0, point, values))


@dataclass(frozen=True, slots=True)
class DeclaredAllowed:
    """A range of an open goal variable (m, rad, m/s), see `AllowedRange`."""

    name: str
    low: float
    high: float

    def __post_init__(self) -> None:
        both = (self.low, self.high)
        require(self.low <= self.high, "low, high", "low not above high", both)


@dataclass(frozen=True, slots=True)
class DeclaredStep:
    """Consecutive steps of a chain with the same TOP."""

    top: str
    goal: Places  # one of them is drawn for each step
    open: tuple[str, ...] = ()  # goal variables that refinement may change, and `order`
    # numbers of the entries of `steps` (from 0) whose steps must be executed before these
    after: tuple[int, ...] = ()
    times: tuple[int, ...] = (1,)  # the number of steps, or the least and the greatest
    allowed: tuple[DeclaredAllowed, ...] = ()  # where open variables may lie

    def __post_init__(self) -> None:
        for each in self.allowed:
            require(each.name in self.open, "allowed.name", "an open variable", each.name)
        times = self.times
        good = (
            len(times) in (1, 2) and 0 <= times[0] <= times[-1] and 1 <= times[-1] <= LONGEST_CHAIN
        )
        require(
            good, "times", f"[a number] or [least, greatest] from 0 to {LONGEST_CHAIN}", list(times)
        )


@dataclass(frozen=True, slots=True)
class DeclaredChain:
    """Random chains.

    Each step is at least `apart` m from the place before, unless both places are fixed.
    """

    name: Annotated[str, NAME]
    start: Places
    steps: tuple[DeclaredStep, ...]
    apart: Apart = 0.5

    def __post_init__(self) -> None:
        least, most = (sum(step.times[end] for step in self.steps) for end in (0, -1))
        require(
            least >= 1 and most <= LONGEST_CHAIN,
            "steps",
            f"1 to {LONGEST_CHAIN} of them",
            (least, most),
        )
        for step in self.steps:
            others = set(range(len(self.steps)))
            require(
                set(step.after) <= others,
                "after",
                f"numbers of entries of steps, 0 to {len(self.steps) - 1}",
                list(step.after),
            )

    def sample(
        self, robot: Robot, library: TopLibrary, rng: np.random.Generator, *, time_limit: float
    ) -> tuple[World, TopChain]:
        """Draw a situation and a chain of at most `time_limit` (s) straight ahead at full speed.

        Raises
        ------
        NoPlaceError
            There is none.
        """

        def length(drawn: tuple[World, TopChain]) -> float:
            places = [drawn[0].robot.pose, *(call.goal.pose for call in drawn[1].calls)]
            return sum(one.distance(other) for one, other in itertools.pairwise(places))

        where = f"chain {self.name}"
        return _drawn_in_time(where, lambda: self._drawn(library, rng), length, robot, time_limit)

    def _drawn(self, library: TopLibrary, rng: np.random.Generator) -> tuple[World, TopChain]:
        before = start = _drawn(self.start, rng)
        was_fixed = _is_fixed(self.start)
        calls: list[TopCall] = []
        drawn: list[range] = []  # the calls of each entry
        for step in self.steps:
            first = len(calls)
            is_fixed = _is_fixed(step.goal)
            for _ in range(int(rng.integers(step.times[0], step.times[-1] + 1))):
                apart = 0.0 if was_fixed and is_fixed else self.apart
                before = _drawn(step.goal, rng, apart=apart, before=before)
                was_fixed = is_fixed
                top = library[step.top]
                goal = library.goal(top, before)
                allowed = tuple(AllowedRange(*astuple(each)) for each in step.allowed)
                call = TopCall(top, goal, frozenset(step.open), allowed=allowed)
                calls.append(call.within_allowed(library.robot, library.ranges))
            drawn.append(range(first, len(calls)))
        for step, own in zip(self.steps, drawn, strict=True):
            after = tuple(sorted(itertools.chain(*(drawn[number] for number in step.after))))
            for index in own:
                calls[index] = dataclasses.replace(calls[index], after=after)
        return World(0.0, RobotState(start)), TopChain(tuple(calls))


@dataclass(frozen=True, slots=True)
class DeclaredTop:
    """A TOP.

    See `Top`. Its conditions are lists of terms with a tolerance or a range (low, high).
    """

    name: Annotated[str, NAME]
    action: str
    post: Annotated[tuple[Term | Region, ...], NOT_EMPTY]  # success is the post-condition
    pre: tuple[Term | Region, ...] = ()
    point: Literal["axle", "hold"] = "axle"
    # After a stop a robot oscillates for seconds; a longer wait is an action of its own.
    settles: Annotated[float, Within(0.0, 60.0)] = 0.0

    def top(self) -> Top:
        """Return the TOP."""
        return Top(
            self.name,
            self.action,
            Condition(self.pre),
            Condition(self.post),
            Point(self.point),
            self.settles,
        )


@dataclass(frozen=True, slots=True)
class LocalAction:
    """The installed domain and its action set that have an action of the same name."""

    domain: str
    action_set: str = DEFAULT_SET


@dataclass(frozen=True, slots=True)
class DeclaredAction:
    """An action, either `local` or `remote`; the other fields are for remote actions only."""

    name: Annotated[str, NAME]
    local: LocalAction | None = None
    remote: RemoteCall | None = None
    goal_variables: tuple[GoalVariable, ...] = ()  # beyond pose and speed
    # entry point of `STAND_INS` that replaces it in simulations without ROS
    stand_in: str | None = None
    drives: DeclaredDrives | None = None  # in which experience is gathered

    def __post_init__(self) -> None:
        given = [kind for kind in ("local", "remote") if getattr(self, kind) is not None]
        require(len(given) == 1, "local, remote", "one of the two", given)
        for part in ("goal_variables", "stand_in", "drives"):
            alone = not getattr(self, part) or self.remote is not None
            require(
                alone,
                part,
                "none without `remote`: a local action has its own",
                getattr(self, part),
            )
        names = [variable.name for variable in self.goal_variables]
        require(STOP not in names, "goal_variables", f"none with the name {STOP}", names)

    @property
    def all_variables(self) -> tuple[GoalVariable, ...]:
        """The goal variables of a remote action, with `STOP` if it can pass its goals."""
        can_pass = self.remote is not None and self.remote.passes
        return (*self.goal_variables, STOPS) if can_pass else self.goal_variables


@dataclass(frozen=True, slots=True)
class DeclaredVariable:
    """A goal variable that refinement may change if a plan opens it, with bounds (m, rad, m/s)."""

    name: Literal["x", "y", "yaw", "speed"]
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        both = (self.low, self.high)
        require((self.low is None) == (self.high is None), "low, high", "both or neither", both)
        if self.low is None or self.high is None:
            return
        require(self.low < self.high, "high", f"a number above low, {self.low:g}", self.high)
        angle = self.name != "yaw" or max(abs(self.low), abs(self.high)) <= math.pi
        require(angle, "low, high", "angles from -3.1416 to 3.1416 rad", both)
        require(
            self.name != "speed" or self.low >= 0.0, "low", "a speed that is not negative", self.low
        )

    def range(self, robot: Robot, goal: Goal) -> Range:
        """Return the range of a goal's variable; a speed is at most the usual one of `robot`."""
        usual = USUAL_RANGES[self.name](robot, goal)
        if self.low is None or self.high is None:
            return usual
        low = self.low
        high = self.high
        if self.name == "yaw":
            return usual.within([(low, high)]) or usual
        if self.name == "speed":
            low = min(low, usual.high)
            high = min(high, usual.high)
        rest = None if usual.rest is None else min(max(usual.rest, low), high)
        return dataclasses.replace(usual, low=low, high=high, rest=rest)


@dataclass(frozen=True, slots=True)
class DeclaredServer:
    """An action server that tools start: `ros2 run PACKAGE EXECUTABLE`, or a command."""

    package: str = ""
    executable: str = ""
    command: tuple[str, ...] = ()  # in words
    folder: str = ""  # working directory of the command; in a domain's file relative to the file

    def __post_init__(self) -> None:
        if self.command:
            alone = not (self.package or self.executable)
            require(alone, "command", "none beside package and executable", self.command)
            return
        require(not self.folder, "folder", "none without `command`", self.folder)
        require(is_name(self.package), "package", "a package (or `command`)", self.package)
        named = re.fullmatch(r"\w[\w.-]*", self.executable)
        require(named is not None, "executable", "an executable as for `ros2 run`", self.executable)

    def beside(self, file: Path) -> DeclaredServer:
        """Return the server with a folder relative to `file`, or to the target of a link."""
        if not self.command:
            return self
        folder = (file.resolve().parent / self.folder).resolve()
        return dataclasses.replace(self, folder=str(folder))

    @property
    def name(self) -> str:
        """The executable, or the command in one line."""
        return self.executable or shlex.join(self.command)


@dataclass(frozen=True, slots=True)
class DeclaredDomain:
    """A whole file; see docs/remote_actions.md."""

    name: Annotated[str, NAME]
    tops: Annotated[tuple[DeclaredTop, ...], NOT_EMPTY]
    actions: tuple[DeclaredAction, ...]
    objects: tuple[ObjectSource, ...] = ()
    variables: tuple[DeclaredVariable, ...] | None = None
    chains: tuple[DeclaredChain, ...] = ()
    robot: str | None = None
    map: str | None = None
    planner: str | None = None  # entry point of `PLANNERS`, whose paths are the routes on the map
    bays: bool = False
    servers: tuple[DeclaredServer, ...] = ()
    time_limit: Duration = TIME_LIMIT

    def __post_init__(self) -> None:
        for part in ("tops", "actions", "objects", "variables", "chains"):
            names = [entry.name for entry in getattr(self, part) or ()]
            twice = sorted({name for name in names if names.count(name) > 1})
            require(not twice, part, "each name once", ", ".join(twice))
        tops = [top.name for top in self.tops]
        for number, chain in enumerate(self.chains):
            for at, step in enumerate(chain.steps):
                place = f"chains[{number}].steps[{at}].top"
                require(step.top in tops, place, f"one of {', '.join(tops)}", step.top)
