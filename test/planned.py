"""Actions that plan, stepped in the simulation until the way is found."""

from __future__ import annotations

import dataclasses
from contextlib import ExitStack, suppress

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, started
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.motion.planning import Search
from ator_ros.motion.trajectory import opening_of
from ator_ros.robot.description import Robot
from ator_ros.simulation.run import place
from ator_ros.simulation.simulation import Simulation
from ator_ros.world.state import World

_MOST_TICKS = 100


def planned(robot: Robot, action: Action, world: World, goal: Goal) -> Step:
    """Start an action, step it until it plans no more or has ended, and return its last step."""
    with Simulation(robot) as simulation:
        place(simulation, world)
        action.start(simulation.world(), goal)
        for _ in range(_MOST_TICKS):
            step = action.step(simulation.world())
            if not action.planning or step.status is not Status.RUNNING:
                return step
            if step.command is not None:
                simulation.command(step.command)
            simulation.tick()
    raise AssertionError(f"expected a plan within {_MOST_TICKS} ticks, got {step.message!r}")


def slices_of(action: PlannedAction, world: World, goal: Goal) -> list[list[int]]:
    """Plan to the end as from rest; return the points of the portions of each slice."""
    with ExitStack() as stack:
        with suppress(ActionError):
            stack.enter_context(started(action, world, goal, "measured"))
        return _searched(action, world)


def _searched(action: PlannedAction, world: World) -> list[list[int]]:
    """Return the points of the portions of each slice, of a search with the goal that `action` has got."""
    slices: list[list[int]] = []
    opening = opening_of(world.robot, action.plan_limits.aw)
    planning = action.plan(dataclasses.replace(world, robot=opening.end))
    search, found = Search(world, opening, planning, standing=True), None
    with suppress(ActionError):
        while found is None:
            slices.append([])
            found = search.advance(float(len(slices)), slices[-1])
    return slices
