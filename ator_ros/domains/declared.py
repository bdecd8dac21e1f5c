"""What the YAML file of a domain declares; each class is one kind of entry."""

from __future__ import annotations

import dataclasses
import math
import shlex
from dataclasses import dataclass
from typing import Literal

from ator_ros.actions import DEFAULT_SET, TIME_LIMIT
from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.remote import LONGEST, RemoteCall
from ator_ros.domains.declared_situations import DeclaredChain, DeclaredDrives
from ator_ros.files import is_name
from ator_ros.robot.description import Robot
from ator_ros.schema import require
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Statement, Term
from ator_ros.tops.ranges import USUAL_RANGES, Range
from ator_ros.world.messages import ObjectSource

STATE_VARIABLES = (*(f"robot.{name}" for name in ("x", "y", "yaw", "v", "w")), "hold.x", "hold.y")
"""The variables of the robot's state that conditions may name."""


def _check_name(name: str, field: str = "name") -> None:
    require(is_name(name), field, "a name of letters, digits and _", name)


@dataclass(frozen=True, slots=True)
class DeclaredTop:
    """A TOP; see `Top`. Its conditions are lists of terms with a tolerance or a range (low, high)."""

    name: str
    action: str
    pre: tuple[Statement, ...] = ()
    post: tuple[Statement, ...] = ()
    point: Literal["axle", "hold"] = "axle"
    settles: float = 0.0

    def __post_init__(self) -> None:
        """Check the name, and that the post-condition says what the TOP is for."""
        _check_name(self.name)
        require(bool(self.post), "post", "at least one term: success is the post-condition", list(self.post))
        # A robot that has stopped oscillates for seconds; a longer wait is an action of its own.
        require(0.0 <= self.settles <= 60.0, "settles", "a time in s from 0 to 60", self.settles)
        terms = (term for term in (*self.pre, *self.post) if isinstance(term, Term))
        least = min((term.tolerance for term in terms), default=0.0)
        require(least >= 0.0, "tolerance", "a number that is not negative", least)

    def top(self) -> Top:
        """Return the TOP."""
        pre, post = Condition(self.pre), Condition(self.post)
        return Top(self.name, self.action, pre, post, Point(self.point), self.settles)


@dataclass(frozen=True, slots=True)
class LocalAction:
    """The action of the same name in a set of an installed domain."""

    domain: str
    action_set: str = DEFAULT_SET


@dataclass(frozen=True, slots=True)
class DeclaredAction:
    """An action: of an installed domain, or on an action server.

    Attributes
    ----------
    name : str
        Its name.
    local, remote : optional
        One of both.
    goal_variables : tuple of GoalVariable
        Of a remote action: goal variables of its own beyond pose and speed.
    stand_in : str or None
        Of a remote action: the installed action that drives as the server does, for simulations without ROS:
        an entry point of `STAND_INS`.
    drives : DeclaredDrives or None
        Of a remote action: the drives from which experience is gathered.
    """

    name: str
    local: LocalAction | None = None
    remote: RemoteCall | None = None
    goal_variables: tuple[GoalVariable, ...] = ()
    stand_in: str | None = None
    drives: DeclaredDrives | None = None

    def __post_init__(self) -> None:
        """Check that either `local` or `remote` is given, and nothing else with `local`."""
        _check_name(self.name)
        given = [kind for kind in ("local", "remote") if getattr(self, kind) is not None]
        require(len(given) == 1, "local, remote", "one of the two", given)
        for part in ("goal_variables", "stand_in", "drives"):
            alone = not getattr(self, part) or self.remote is not None
            require(alone, part, "none without `remote`: a local action has its own", getattr(self, part))


@dataclass(frozen=True, slots=True)
class DeclaredVariable:
    """A goal variable that refinement may change where a plan opens it, and its bounds (m, rad, m/s)."""

    name: Literal["x", "y", "yaw", "speed"]
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        """Check the bounds."""
        both = (self.low, self.high)
        require((self.low is None) == (self.high is None), "low, high", "both or neither", both)
        if self.low is None or self.high is None:
            return
        require(self.low < self.high, "high", f"a number above low, {self.low:g}", self.high)
        angle = self.name != "yaw" or max(abs(self.low), abs(self.high)) <= math.pi
        require(angle, "low, high", "angles from -3.1416 to 3.1416 rad", both)
        require(self.name != "speed" or self.low >= 0.0, "low", "a speed that is not negative", self.low)

    def range(self, robot: Robot, goal: Goal) -> Range:
        """Return the values that it may take; a speed is at most what `robot` is searched with."""
        usual = USUAL_RANGES[self.name](robot, goal)
        if self.low is None or self.high is None:
            return usual
        low, high = self.low, self.high
        if self.name == "speed":
            low, high = min(low, usual.high), min(high, usual.high)
        rest = None if usual.rest is None else min(max(usual.rest, low), high)
        return dataclasses.replace(usual, low=low, high=high, periodic=False, rest=rest)


@dataclass(frozen=True, slots=True)
class DeclaredServer:
    """An action server that tools start beside our nodes: an executable of a ROS package, or a command.

    Attributes
    ----------
    package, executable : str
        As `ros2 run PACKAGE EXECUTABLE` starts it.
    command : str or tuple of str
        In place of both: the words of a command. A text is split as a shell does.
    folder : str
        The folder in which the command runs; in a domain's file relative to the file.
    """

    package: str = ""
    executable: str = ""
    command: str | tuple[str, ...] = ()
    folder: str = ""

    def __post_init__(self) -> None:
        """Check that there is either an executable or a command."""
        if self.command:
            alone = not (self.package or self.executable)
            require(alone, "command", "none beside package and executable", self.command)
            try:
                found = bool(self.words)
            except ValueError:  # a quotation that does not end
                found = False
            require(found, "command", "words as in a shell", self.command)
            return
        for field in ("package", "executable"):
            name = getattr(self, field)
            require(is_name(name), field, "a name of letters, digits and _ (or `command`)", name)

    @property
    def words(self) -> list[str]:
        """The words of the command; empty without one."""
        return shlex.split(self.command) if isinstance(self.command, str) else list(self.command)

    @property
    def name(self) -> str:
        """The executable, or the command in one line."""
        return self.executable or shlex.join(self.words)


@dataclass(frozen=True, slots=True)
class DeclaredDomain:
    """A whole file; see docs/remote_actions.md."""

    name: str
    tops: tuple[DeclaredTop, ...]
    actions: tuple[DeclaredAction, ...]
    objects: tuple[ObjectSource, ...] = ()
    variables: tuple[DeclaredVariable, ...] | None = None
    chains: tuple[DeclaredChain, ...] = ()
    robot: str | None = None
    bays: bool = False
    servers: tuple[DeclaredServer, ...] = ()
    time_limit: float = TIME_LIMIT

    def __post_init__(self) -> None:
        """Check that names come once, and that chains name TOPs that there are."""
        _check_name(self.name)
        longest = f"a time in s above 0, at most {LONGEST:g}"
        require(0.0 < self.time_limit <= LONGEST, "time_limit", longest, self.time_limit)
        for part in ("tops", "actions", "objects", "variables", "chains"):
            names = [entry.name for entry in getattr(self, part) or ()]
            twice = sorted({name for name in names if names.count(name) > 1})
            require(not twice, part, "each name once", ", ".join(twice))
        require(bool(self.tops), "tops", "at least one", list(self.tops))
        tops = [top.name for top in self.tops]
        for number, chain in enumerate(self.chains):
            for at, step in enumerate(chain.steps):
                place = f"chains[{number}].steps[{at}].top"
                require(step.top in tops, place, f"one of {', '.join(tops)}", step.top)
