"""Teleo-operators and chains of them (paper, section 2.1; Nilsson 1994).

A TOP is an action with its pre- and post-condition. In a chain each post-condition satisfies the
next pre-condition.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import ORDER, STOP, goal_values, passes, with_values
from ator_ros.bases.description import Robot
from ator_ros.geometry import Pose
from ator_ros.printable import ReadableError
from ator_ros.tops.conditions import Condition, Term, arrived, state_of
from ator_ros.tops.ranges import Range, Ranges
from ator_ros.world.state import ObjectState, RobotState, World

_NOT_PASSED = ("robot.yaw", "robot.vx", "robot.vy", "robot.w")
"""State variables that are neither commanded nor judged where the robot passes its goal."""


@dataclass(frozen=True, slots=True)
class Top:
    """A teleo-operator.

    Attributes
    ----------
    pre : Condition
        States from which the action will eventually make `post` hold.
    post : Condition
        Intended effect; the goal variables that it names define the purpose of the step.
    point : Point
        Point of the robot that the goal's position is meant for.
    settles : float
        Time in s that objects may move on after the action has ended, until `post` holds.
    """

    name: str
    action: str
    pre: Condition
    post: Condition
    point: Point = Point.AXLE
    settles: float = 0.0

    def lacks(self, robot: Robot) -> str | None:
        """Return a message if the goal or the conditions need a holder and the robot has none.

        Else None.
        """
        if robot.holder is not None:
            return None
        if self.point is not Point.HOLD and "hold" not in self.pre.things() | self.post.things():
            return None
        return f"{self.name} needs a holder; robot {robot.name} has none"

    @property
    def place_tolerance(self) -> float:
        """Greatest distance in m between a place and the goal, by the post-condition."""
        terms = (term for term in self.post.terms if term.variable.endswith(".x"))
        return math.fsum(term.tolerance for term in terms if isinstance(term, Term))

    @property
    def arrives(self) -> bool:
        """Whether the robot ends at the goal: the post-condition places its axle or its hold."""
        return any(term.variable in ("robot.x", "hold.x") for term in self.post.terms)

    def arrival(self) -> dict[str, tuple[str, ...]]:
        """Return the goal variables that determine the robot's variables after an arrival."""
        holds = self.point is Point.HOLD
        at = "hold" if holds else "robot"
        other = "robot" if holds else "hold"
        beside = {f"{other}.{axis}": (axis, "yaw") for axis in "xy"}
        robot = {"robot.yaw": ("yaw",), "robot.vx": ("speed",), "robot.vy": (), "robot.w": ()}
        return {f"{at}.x": ("x",), f"{at}.y": ("y",), **beside, **robot}

    def unmet(
        self,
        world: World,
        goal: Goal,
        robot: Robot,
    ) -> list[str]:
        """Return why the post-condition does not hold in `world`; empty if it holds.

        Of a goal that is passed, heading and velocities of the robot are not judged.
        """
        return self.effect(goal).violations(state_of(world, robot), goal_values(goal))

    def effect(self, goal: Goal) -> Condition:
        """Return the part of the post-condition that is judged at a goal."""
        if not passes(goal):
            return self.post
        terms = (term for term in self.post.terms if term.variable not in _NOT_PASSED)
        return dataclasses.replace(self.post, terms=tuple(terms))

    def failure(self, violations: Iterable[str]) -> str:
        """Return the reason of a failure from the violations of the post-condition."""
        return f"post-condition of {self.name}: {'; '.join(violations)}"

    def shortfall(
        self,
        world: World,
        goal: Goal,
        robot: Robot,
    ) -> float:
        """Return how far `world` is from the post-condition, in the unit of the worst variable."""
        return self.effect(goal).shortfall(state_of(world, robot), goal_values(goal))

    def may_settle(self, world: World) -> bool:
        """Return whether an object of the post-condition still moves."""
        objects = (world.objects.get(name) for name in self.post.objects())
        return any(there is not None and not there.is_resting for there in objects)


EVERYTHING = "*"
"""Opens all goal variables but those that the post-condition names."""


class AllowedRange(NamedTuple):
    """An interval within which a plan leaves a goal variable open (m, rad, m/s, or as declared).

    An angle goes from `low` counter-clockwise to `high`.
    """

    name: str
    low: float
    high: float


class InvalidChainError(ReadableError, ValueError):
    """A chain that is not a valid plan in the present situation."""


@dataclass(frozen=True, slots=True)
class TopCall:
    """One step of a chain.

    Attributes
    ----------
    goal : Goal
        The values of opened variables are preliminary.
    open : frozenset of str
        The goal variables (x, y, yaw, speed, declared ones) that refinement may change, or
        `EVERYTHING`. The plan commits to the others. `ORDER` opens the call's place in the chain,
        and `STOP` whether the robot stops.
    after : tuple of int
        Indices of the calls of the chain (from 0) that must be executed before this one.
    allowed : tuple of AllowedRange
        Where opened variables may lie. Several ranges of one variable: within any of them.
    """

    top: Top
    goal: Goal
    open: frozenset[str] = frozenset()
    after: tuple[int, ...] = ()
    allowed: tuple[AllowedRange, ...] = ()

    def contradictions(self, robot: Robot) -> list[str]:
        """Return the statements of the post-condition that cannot hold with the robot at the goal.

        They compare a variable of the robot with a number. Variables that the plan opens may still
        change, and are not compared.
        """
        if not self.top.arrives:
            return []
        here = arrived(World(0.0, RobotState(Pose(0.0, 0.0, 0.0), 0.0)), self.goal, robot)
        state = state_of(here, robot)
        goal = goal_values(self.goal)
        determined_by = self.top.arrival()
        found = []
        for term in self.top.effect(self.goal).terms:
            names = determined_by.get(term.variable)
            if names is None or isinstance(term.target, str) or any(map(self.opens, names)):
                continue
            if reason := term.violation(state, goal):
                found.append(reason)
        return found

    def opens(self, name: str) -> bool:
        """Return whether the plan opens the goal variable `name`.

        A condition may bind it all the same.
        """
        if name in self.open:
            return True
        if name == STOP:
            return False
        if name == "speed" and STOP in self.open and STOP not in self.goal.values:
            return True
        return EVERYTHING in self.open and name not in self.top.post.goal_names()

    @property
    def passing(self) -> bool:
        """Whether the robot passes the goal without a stop."""
        return passes(self.goal)

    @property
    def may_stop(self) -> bool:
        """Whether the plan opens `STOP`, for an action that has it as a goal variable."""
        return self.opens(STOP) and STOP in self.goal.values

    def stop_fault(self, following: TopCall | None) -> str | None:
        """Return why the robot cannot pass the goal if `following` is the next call.

        None if it can, or need not. A step is passed when the next one takes over from its action.
        """
        if not self.passing:
            return None
        if following is None:
            return "the last step of a chain must stop"
        if following.top.action != self.top.action:
            return f"it must stop before another action, {following.top.action}"
        return None

    def range_of(self, name: str, robot: Robot, ranges: Ranges) -> Range | None:
        """Return the part of a goal variable's range that the plan allows.

        None if the variable has no range, or nothing of it is allowed.
        """
        if name not in ranges:
            return None
        usual = ranges[name](robot, self.goal)
        intervals = [(low, high) for limited, low, high in self.allowed if limited == name]
        return usual.within(intervals) if intervals else usual

    def limits_of(self, name: str) -> tuple[str, ...]:
        """Return a description of each range that the plan allows for a goal variable."""
        return tuple(
            f"allowed {low:g} to {high:g}" for limited, low, high in self.allowed if limited == name
        )

    def within_allowed(self, robot: Robot, ranges: Ranges) -> TopCall:
        """Return the call with limited variables at the nearest values that the plan allows."""
        values = goal_values(self.goal)
        moved: dict[str, float] = {}
        for name in {each.name for each in self.allowed}:
            domain = self.range_of(name, robot, ranges)
            if domain is not None and not domain.contains(values[name]):
                moved[name] = float(domain.nearest(np.array([values[name]]))[0])
        goal = with_values(self.goal, moved) if moved else self.goal
        return dataclasses.replace(self, goal=goal)


@dataclass(frozen=True, slots=True)
class TopChain:
    """A plan: the steps in the order of their execution.

    Attributes
    ----------
    calls : tuple of TopCall
        The steps.
    sent_as : tuple of int
        Index of each call in the chain as it was sent; empty if that is its own.
    """

    calls: tuple[TopCall, ...]
    sent_as: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.calls)

    @property
    def order(self) -> tuple[int, ...]:
        """The indices of the calls in the chain as it was sent."""
        return self.sent_as or tuple(range(len(self.calls)))

    def part(self, first: int, last: int | None = None) -> TopChain:
        """Return the calls from `first` to before `last` as a chain; they keep their places."""
        calls = (
            dataclasses.replace(call, open=call.open - {ORDER}, after=())
            for call in self.calls[first:last]
        )
        return TopChain(tuple(calls))

    def sent(self, index: int) -> TopCall:
        """Return the call with an index (from 0) in the chain as it was sent."""
        return self.calls[self.order.index(index)]

    def step_name(self, index: int) -> str:
        """Return number and TOP of a call (from 0) for messages; the number is that as sent."""
        return f"step {self.order[index] + 1} ({self.calls[index].top.name})"

    def reordered(self, order: Sequence[int]) -> TopChain:
        """Return the chain with its calls in another order, given by their indices in this one."""
        place = {index: number for number, index in enumerate(order)}
        calls = []
        for index in order:
            call = self.calls[index]
            if call.after:
                after = tuple(sorted(place[other] for other in call.after))
                call = dataclasses.replace(call, after=after)
            calls.append(call)
        sent_as = tuple(self.order[index] for index in order)
        return TopChain(tuple(calls), () if sent_as == tuple(range(len(calls))) else sent_as)

    def with_goal(
        self,
        index: int,
        goal: Goal,
    ) -> TopChain:
        """Return the chain with the goal of step `index` (from 0) replaced."""
        calls = list(self.calls)
        calls[index] = dataclasses.replace(calls[index], goal=goal)
        return dataclasses.replace(self, calls=tuple(calls))

    def with_stop(self, index: int, start: Pose) -> TopChain:
        """Return the chain in which step `index` (from 0) stops, coming from `start`."""
        goal = _passed(self.calls[index].goal, start)
        return self.with_goal(index, with_values(goal, {STOP: 1.0}))

    def violations(
        self,
        world: World,
        robot: Robot,
    ) -> list[str]:
        """Return the reasons why the chain is not a valid plan from `world`.

        Empty if it is valid.
        """
        if not self.calls:
            return ["expected at least one step, got an empty chain"]
        for call in self.calls:
            if reason := call.top.lacks(robot):
                return [reason]
        found = [
            f"{self.step_name(index)} must come after {self.step_name(other)}"
            for index, call in enumerate(self.calls)
            for other in call.after
            if index < other < len(self.calls)
        ]
        for index, call in enumerate(self.calls):
            following = self.calls[index + 1] if index + 1 < len(self.calls) else None
            if fault := call.stop_fault(following):
                found.append(f"{self.step_name(index)}: passing: {fault}")
        when = "now"
        for index, call in enumerate(self.calls):
            where = f"pre-condition of {self.step_name(index)} {when}"
            reasons = call.top.pre.violations(state_of(world, robot), goal_values(call.goal))
            found += [f"{where}: {reason}" for reason in reasons]
            when = f"after {self.step_name(index)}"
            world = projected(world, call, robot)
        return found


def projected(
    world: World,
    call: TopCall,
    robot: Robot,
) -> World:
    """Return the world after `call`, in which its post-condition holds.

    Placed objects are at rest.
    """
    variables = {term.variable for term in call.top.post.terms}
    if call.passing:
        call = dataclasses.replace(call, goal=_passed(call.goal, world.robot.pose))
    if call.top.arrives:
        world = arrived(world, call.goal, robot)
    state = call.top.post.apply(state_of(world, robot), goal_values(call.goal))
    if not call.top.arrives and any(name.startswith("robot.") for name in variables):
        pose = Pose(state["robot.x"], state["robot.y"], state["robot.yaw"])
        vx, vy, w = (state[f"robot.{name}"] for name in ("vx", "vy", "w"))
        world = dataclasses.replace(world, robot=RobotState(pose, vx, w, vy=vy))
    for name in sorted(call.top.post.objects()):
        x = state.get(f"{name}.x")
        y = state.get(f"{name}.y")
        placed = not variables.isdisjoint((f"{name}.x", f"{name}.y"))
        if placed and x is not None and y is not None:
            world = world.with_object(name, ObjectState(x, y))
    return world


def _passed(goal: Goal, start: Pose) -> Goal:
    """Return a goal with the heading in which a robot passes it that comes from `start`."""
    x, y, _ = goal.pose
    if start.distance(goal.pose) == 0.0:
        return goal
    bearing = math.atan2(y - start.y, x - start.x)
    return dataclasses.replace(goal, pose=Pose(x, y, bearing))
