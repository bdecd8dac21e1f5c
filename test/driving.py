"""Goals executed in simulation, as the executor node does, on various bases."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

from executions import execution as execution_of

from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.robot.description import Robot
from ator_ros.simulation.sensors import ObjectErrors, SensorConfig, Sensors
from ator_ros.simulation.simulation import TICK, Simulation
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.estimation import ObjectTracker
from ator_ros.world.state import STOP, Command, World

_LONGEST = 60.0


def same(world: World) -> World:
    return world


@dataclass(frozen=True)
class Base:
    """How the base and its sensors differ from the described robot."""

    sensors: SensorConfig = field(default_factory=SensorConfig)
    latency: float = 0.0  # s, which the executor compensates
    motor_lag: float = 0.0  # time constant in s; 0: as described
    dead_zone: Command = STOP  # speeds up to which a command does nothing
    scale: float = 1.0  # of the described speeds and accelerations

    def robot(self, robot: Robot) -> Robot:
        """Return the actual robot."""
        lag = self.motor_lag or robot.motor_time_constant
        return dataclasses.replace(robot, motor_time_constant=lag, limits=robot.limits.scaled(self.scale))

    def respond(self, command: Command) -> Command:
        """Return the motion that the base makes of a command."""
        v = 0.0 if abs(command.v) <= self.dead_zone.v else command.v
        w = 0.0 if abs(command.w) <= self.dead_zone.w else command.w
        return Command(v, w)


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
    base: Base | None = None,
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
    base, robot = base or Base(), library.robot
    execution = execution_of(chain, library=library, again_after=0.0, now=0.0, fence=fence)
    done, watch, sensors = Drive(execution), MotionWatch(robot, base.latency), Sensors(base.sensors, seed)
    errors = base.sensors.objects.get(BALL, ObjectErrors())
    tracker, last = ObjectTracker(errors.noise, errors.velocity_noise), -1.0
    with Simulation(base.robot(robot)) as simulation:
        simulation.place_robot(start.robot.pose, v=start.robot.v, w=start.robot.w)
        if ball_of(start) is not None:
            simulation.place_object(
                BALL, ball_of(start).x, ball_of(start).y, vx=ball_of(start).vx, vy=ball_of(start).vy
            )
        while execution.phase is not Phase.ENDED and simulation.time < limit:
            world = simulation.world()
            observed, now = sensors.observe(world), world.time
            if ball_of(observed) is not None:
                observed = observed.with_object(BALL, tracker.update(observed.time, ball_of(observed)))
            observed = odometry(observed)
            if observed.time > last:
                last = observed.time
                fault = watch.fault(observed.time, observed.robot, now)
                command = execution.tick(watch.foresight.ahead(observed), now, fault=fault)
                watch.sent(observed.time, command)
                simulation.command(motors(now, command) if motors else base.respond(command))
                if done.ended is None and execution.ending is not None:
                    done.ended = now
                done.commands.append(command)
                done.worlds.append(world)
            simulation.tick()
    return done


LATE = Base(SensorConfig(latency=0.1), latency=0.1 + TICK)
