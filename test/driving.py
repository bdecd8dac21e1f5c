"""Goals executed in simulation, as the executor node executes them."""

from collections.abc import Callable
from dataclasses import dataclass, field

from executions import execution as execution_of

from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.simulation.run import place
from ator_ros.simulation.sensors import SensorConfig, Sensors
from ator_ros.simulation.simulation import TICK, Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import Command, World

_LONGEST = 60.0


def same(world: World) -> World:
    return world


@dataclass
class Drive:
    """Result of a goal: its execution, and the true state and the command of each tick."""

    execution: Supervisor
    worlds: list[World] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    ended: float | None = None
    """The time in s of the state at which `ending` was set."""

    @property
    def ending(self) -> Ending | None:
        return self.execution.ending

    @property
    def reason(self) -> str:
        return self.execution.reason


def drive(
    library: TopLibrary,
    start: World,
    chain: TopChain,
    sensors: SensorConfig | None = None,
    *,
    seed: int = 0,
    fence: Fence | None = None,
    odometry: Callable[[World], World] = same,
    motors: Callable[[float, Command], Command] | None = None,
    limit: float = _LONGEST,
) -> Drive:
    """Execute a goal from `start` until it ends, at most for `limit` s.

    `odometry` changes the observed world, `motors` the response of the base to a command at a time (s).
    """
    config, last = sensors or SensorConfig(), -1.0
    execution = execution_of(chain, library=library, again_after=0.0, now=0.0, fence=fence)
    latency = config.latency and config.latency + TICK  # of states and commands
    done, watch, observer = Drive(execution), MotionWatch(library.robot, latency), Sensors(config, seed)
    with Simulation(library.robot) as simulation:
        place(simulation, start)
        while execution.phase is not Phase.ENDED and simulation.time < limit:
            world = simulation.world()
            observed, now = odometry(observer.observe(world)), world.time
            if observed.time > last:
                last = observed.time
                fault = watch.fault(observed.time, observed.robot, now)
                command = execution.tick(watch.foresight.ahead(observed), now, fault=fault)
                watch.sent(observed.time, command)
                simulation.command(motors(now, command) if motors else command)
                if done.ended is None and execution.ending is not None:
                    done.ended = now
                done.commands.append(command)
                done.worlds.append(world)
            simulation.tick()
    return done
