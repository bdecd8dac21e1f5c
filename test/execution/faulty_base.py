"""A kinematic base that can fail on one axis, and goals executed on it as by the executor node."""

import copy
import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from executions import execution as execution_of

from ator_ros.bases.description import Robot
from ator_ros.bases.differential.response import ramped
from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.bases.omni.planar_response import planar_ramp
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, Command, ObjectState, RobotState, World

DT = 0.01
TIMEOUT = 0.15


@dataclass(frozen=True)
class Failure:
    """A failure on `axis` (vx, vy or w) from `since` s on.

    `kind` is stuck, reversed, constant, delayed (by 1 s), or half. `place` says where: in the
    command, which the base then ramps; in the motion, at once; or in the odometry, which does not
    show the motion (stuck).
    """

    kind: str
    axis: str
    since: float
    place: str = "command"
    value: float = 0.0


@dataclass
class KinematicBase:
    """A base that follows commands within limits and lags, and reports odometry."""

    robot: Robot
    pose: Pose
    lag: float = 0.0  # s; 0: as described
    share: float = 1.0  # of the commanded speed
    strength: float = 1.0  # of the acceleration
    latency: float = 0.0
    dead_band: Command = STOP
    failure: Failure | None = None
    time: float = 0.0
    sent: list[tuple[float, Command]] = field(default_factory=list)
    setpoint: Command = STOP
    speeds: Command = STOP
    shown: Pose | None = None

    def command(self, command: Command) -> None:
        self.sent.append((self.time + self.latency, command))

    def _sent(self, time: float) -> Command:
        acts, command = next(
            ((a, c) for a, c in reversed(self.sent) if a <= time + 1e-9), (0.0, STOP)
        )
        return command if time - acts < TIMEOUT else STOP

    def _fails(self, places: tuple[str, ...]) -> Failure | None:
        failure = self.failure
        return (
            failure
            if failure and failure.place in places and self.time >= failure.since - 1e-9
            else None
        )

    def _wrong(self, failure: Failure, value: float) -> float:
        if failure.kind == "delayed":
            return float(getattr(self._sent(self.time - 1.0), failure.axis))
        share = {"stuck": 0.0, "reversed": -1.0, "half": 0.5}
        return failure.value if failure.kind == "constant" else share[failure.kind] * value

    def step(self) -> None:
        command = self._sent(self.time)
        command = Command(
            0.0 if abs(command.vx) <= self.dead_band.vx else self.share * command.vx,
            0.0 if abs(command.w) <= self.dead_band.w else self.share * command.w,
            vy=self.share * command.vy,
        )
        failure = self._fails(("command",))
        if failure:
            command = _with(
                command, failure.axis, self._wrong(failure, getattr(command, failure.axis))
            )
        self._follow(command)
        failure = self._fails(("motion",))
        if failure:
            wrong = self._wrong(failure, getattr(self._sent(self.time), failure.axis))
            self.speeds = _with(self.speeds, failure.axis, wrong)
        self.pose = _moved(self.pose, self.speeds)
        self.shown = _moved(self.shown or self.pose, self.odometry())
        self.time += DT

    def _follow(self, command: Command) -> None:
        """Let setpoint and speeds follow a command for `DT`."""
        robot = self.robot
        follows = min(1.0, DT / (self.lag or robot.lag))
        limits = robot.limits.scaled(self.strength)
        if isinstance(robot, OmniRobot):
            self.setpoint = planar_ramp(self.setpoint, command, DT, limits.rates, robot.stop)
            # The robot turns under the same velocity over the floor.
            turned = Pose(0.0, 0.0, self.speeds.w * DT)
            vx, vy, _ = turned.relative(Pose(self.speeds.vx, self.speeds.vy, 0.0))
            self.speeds = Command(vx, self.speeds.w, vy=vy)
        else:
            self.setpoint = ramped(self.setpoint, command, DT, limits, robot.stop)
        vx, vy, w = (
            s + (c - s) * follows
            for s, c in zip(_values(self.speeds), _values(self.setpoint), strict=True)
        )
        self.speeds = Command(vx, w, vy=vy)

    def odometry(self) -> Command:
        failure = self._fails(("odometry",))
        return _with(self.speeds, failure.axis, 0.0) if failure else self.speeds

    def state(self) -> RobotState:
        shows = self.odometry()
        return RobotState(self.shown or self.pose, shows.vx, shows.w, vy=shows.vy)


def _values(command: Command) -> tuple[float, float, float]:
    return command.vx, command.vy, command.w


def _with(command: Command, axis: str, value: float) -> Command:
    return dataclasses.replace(command, **{axis: value})


def _moved(pose: Pose, speeds: Command) -> Pose:
    middle = pose._replace(yaw=pose.yaw + 0.5 * speeds.w * DT)
    x, y, _ = middle.compose(Pose(speeds.vx * DT, speeds.vy * DT, 0.0))
    return Pose(x, y, wrap_angle(pose.yaw + speeds.w * DT))


@dataclass
class Goal:
    """Result of a goal. Times are in s."""

    execution: Supervisor
    watch: MotionWatch
    states: list[tuple[float, RobotState]] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    late: float = 0.0
    """The longest interval in which odometry differed from that of a healthy base."""
    ended: float | None = None

    @property
    def ending(self) -> Ending | None:
        return self.execution.ending


def tolerances(robot: Robot) -> Command:
    """Return the differences in m/s and rad/s from which odometry differs."""
    least = {"m/s": 0.04, "rad/s": 0.1}
    found = {
        axis.name: 1.5 * min(max(0.04 * axis.limit, least[axis.unit]), 0.4 * axis.limit)
        for axis in robot.axes
    }
    return Command(**{"vy": math.inf, **found})


def execute(
    library: TopLibrary,
    chain: TopChain,
    base: KinematicBase,
    *,
    rate: float = 20.0,
    latency: float = 0.0,
    fence: Fence | None = None,
    objects: Callable[[float], dict[str, ObjectState]] = lambda _: {},
    sense: Callable[[float, RobotState], RobotState] = lambda _, state: state,
    jitter: float = 0.0,
    dropped: float = 0.0,
    longest: float = 60.0,
    until_stood: bool = True,
    cancel: float = math.inf,
) -> Goal:
    """Execute a goal until it ends, at most for `longest` s.

    `objects` and `sense` return the observed objects and the observed state of the robot at a time
    (s).
    """
    robot, rng = library.robot, np.random.default_rng(0)
    fence = fence or Fence(-100.0, -100.0, 100.0, 100.0)
    execution = execution_of(chain, library=library, again_after=0.0, now=0.0, fence=fence)
    goal, twin = Goal(execution, MotionWatch(robot, latency)), None
    due, stopped = 0.0, False
    since: float | None = None
    while execution.phase is not Phase.ENDED and base.time < longest:
        if base.time >= cancel and execution.ending is None:
            execution.end(Ending.CANCELED, "canceled by the client")
        if base.failure and twin is None and base.time >= base.failure.since - 1e-9:
            twin = copy.deepcopy(base)
            twin.failure = None
        if twin and base.time >= due - 1e-9:
            pairs = zip(
                _values(base.odometry()),
                _values(twin.odometry()),
                _values(tolerances(robot)),
                strict=True,
            )
            differs = any(_differ(base, *pair) for pair in pairs)
            since = (since if since is not None else base.time) if differs else None
            goal.late = max(goal.late, 0.0 if since is None else base.time - since)
        if base.time >= due - 1e-9:
            due += (1.0 + rng.uniform(-jitter, jitter)) / rate
            if rng.random() >= dropped:
                state = sense(base.time, base.state())
                world = World(base.time, state, objects(base.time))
                command = execution.tick(
                    goal.watch.foresight.ahead(world),
                    base.time,
                    fault=goal.watch.fault(base.time, state, base.time),
                )
                goal.watch.sent(base.time, command, base.time)
                _command((base, twin), command or STOP)
                goal.states.append((base.time, base.state()))
                goal.commands.append(command or STOP)
                stopped = False
        elif not stopped and execution.odometry_is_late(base.time):
            goal.watch.sent(base.time, STOP, base.time)
            _command((base, twin), STOP)
            stopped = True
        if goal.ended is None and execution.ending is not None:
            goal.ended = base.time
            if not until_stood:
                break
        for each in (base, twin):
            if each:
                each.step()
    return goal


def _differ(base: KinematicBase, shown: float, healthy: float, tolerance: float) -> bool:
    """Return whether a speed differs.

    A constant lower one may be the top speed of a slower base.
    """
    slower = shown * healthy > 0.0 and 0.25 * abs(healthy) <= abs(shown) <= abs(healthy)
    return abs(shown - healthy) > tolerance and not (
        base.failure.kind in ("constant", "delayed") and slower
    )


def _command(bases: tuple[KinematicBase | None, ...], command: Command) -> None:
    for base in bases:
        if base:
            base.command(command)
