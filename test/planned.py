"""Actions that plan, stepped in the simulation until the way is found."""

from __future__ import annotations

from ator_ros.actions.base import Action, Goal, Status, Step
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
