"""How fast the simulation is: times real time, and over the bare loop of Bullet's steps."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable

from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.geometry import Pose
from ator_ros.robot.description import Robot
from ator_ros.simulation import physics as p
from ator_ros.simulation.simulation import CONTROL_RATE, RAMPS_PER_TICK, Simulation
from ator_ros.tools.benchmarks.rows import SimulationSpeed
from ator_ros.world.state import Command

CONTACT = "with a held object"
LIMITS_TIMES_REAL_TIME = {CONTACT: 100.0, "without objects": 150.0}
LIMIT_OVER_BARE = 1.3
_BLOCK_S = 5.0
_SPEEDS = (Command(0.6, 0.3), Command(0.6, -0.3))


def measure(source: ToolsetSource, blocks: int = 12) -> dict[str, SimulationSpeed]:
    """Return for each case the simulated seconds per second and the cost over the bare loop.

    Blocks of 5 simulated seconds of both loops alternate and the fastest of each counts, so that a busy
    machine disturbs both alike.
    """
    domain, robot = find_domain(source.domain), source.described()
    results = {}
    for name, limit in LIMITS_TIMES_REAL_TIME.items():
        held = domain.objects[0] if name == CONTACT else None
        pairs = [(_timed(_drive, robot, held), _timed(_bare, robot, held)) for _ in range(blocks)]
        ours, bare = map(min, zip(*pairs, strict=True))
        speed, over = round(_BLOCK_S / ours, 1), round(ours / bare, 3)
        results[name] = SimulationSpeed(speed, limit, over, LIMIT_OVER_BARE)
    return results


def _timed(loop: Callable[[Simulation, int], None], robot: Robot, held: str | None) -> float:
    """Return how long `loop` takes for a block in which the robot drives in bends, with an object or none."""
    with Simulation(robot) as simulation:
        start = Pose(0.0, 0.0, 0.0)
        simulation.place_robot(start)
        if held is not None:
            place = robot.hold_point(start)
            simulation.place_object(held, place.x, place.y)
        _drive(simulation, CONTROL_RATE)
        began = time.perf_counter()
        loop(simulation, round(_BLOCK_S * CONTROL_RATE))
        return time.perf_counter() - began


def _drive(simulation: Simulation, ticks: int) -> None:
    bends = itertools.cycle(itertools.chain.from_iterable(itertools.repeat(c, CONTROL_RATE) for c in _SPEEDS))
    for command in itertools.islice(bends, ticks):
        simulation.command(command)
        simulation.tick()
        simulation.world()


def _bare(simulation: Simulation, ticks: int) -> None:
    """Step the same world with the same settings, without our code: the wheels keep their last speeds."""
    for _ in range(ticks * RAMPS_PER_TICK):
        p.stepSimulation(physicsClientId=simulation._client)
