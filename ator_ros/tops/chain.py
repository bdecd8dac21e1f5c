"""TOP chains: each post-condition satisfies the next pre-condition (paper, section 2.1)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.state import arrived, state_of
from ator_ros.tops.top import Top
from ator_ros.world.state import ObjectState, RobotState, World

EVERYTHING = "*"
"""Among the opened goal variables: all but those that say what the step is for."""


class InvalidChainError(ValueError):
    """A chain that is no valid plan from the present situation; the message says why."""


@dataclass(frozen=True, slots=True)
class TopCall:
    """One step of a chain.

    Attributes
    ----------
    top : Top
        The teleo-operator.
    goal : Goal
        Its goal; the values of opened variables are preliminary.
    open : frozenset of str
        The goal variables (x, y, yaw, speed, declared ones) that may be changed; `EVERYTHING` opens all but
        those that the TOP's post-condition names. The plan commits to the others.
    """

    top: Top
    goal: Goal
    open: frozenset[str] = frozenset()

    def opens(self, name: str) -> bool:
        """Return whether the plan opens the goal variable `name`; a condition may bind it all the same."""
        return name in self.open or (EVERYTHING in self.open and name not in self.top.post.goal_names())


@dataclass(frozen=True, slots=True)
class TopChain:
    """A plan: the steps in the order of their execution."""

    calls: tuple[TopCall, ...]

    def __len__(self) -> int:
        return len(self.calls)

    def with_goal(self, index: int, goal: Goal) -> TopChain:
        """Return the chain with the goal of step `index` (from 0) replaced."""
        calls = list(self.calls)
        calls[index] = dataclasses.replace(calls[index], goal=goal)
        return TopChain(tuple(calls))

    def violations(self, world: World, robot: Robot) -> list[str]:
        """Return in words why the chain is no valid plan from `world`; an empty list means that it is."""
        if not self.calls:
            return ["expected at least one step, got an empty chain"]
        lacking = [reason for call in self.calls if (reason := call.top.lacks(robot))]
        if lacking:
            return lacking[:1]
        found = []
        for number, call in enumerate(self.calls, start=1):
            reasons = call.top.pre.violations(state_of(world, robot), goal_values(call.goal))
            when = "now" if number == 1 else f"after step {number - 1} ({self.calls[number - 2].top.name})"
            found += [
                f"pre-condition of step {number} ({call.top.name}) {when}: {reason}" for reason in reasons
            ]
            world = projected(world, call, robot)
        return found

    def check(self, world: World, robot: Robot) -> None:
        """Make sure that the chain is a valid plan from `world`.

        Raises
        ------
        InvalidChainError
            It is not; the message lists all reasons.
        """
        reasons = self.violations(world, robot)
        if reasons:
            raise InvalidChainError("; ".join(reasons))


def projected(world: World, call: TopCall, robot: Robot) -> World:
    """Return the world after `call`, in which its post-condition holds; placed objects are at rest."""
    variables = {term.variable for term in call.top.post.terms}
    if call.top.arrives:
        world = arrived(world, call.goal, robot)
    state = call.top.post.apply(state_of(world, robot), goal_values(call.goal))
    if not call.top.arrives and any(name.startswith("robot.") for name in variables):
        pose = Pose(state["robot.x"], state["robot.y"], state["robot.yaw"])
        world = dataclasses.replace(world, robot=RobotState(pose, state["robot.v"], state["robot.w"]))
    for name in sorted(call.top.post.objects()):
        x, y = state.get(f"{name}.x"), state.get(f"{name}.y")
        if variables & {f"{name}.x", f"{name}.y"} and x is not None and y is not None:
            world = world.with_object(name, ObjectState(x, y))
    return world
