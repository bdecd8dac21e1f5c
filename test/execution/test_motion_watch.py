"""The motion watch detects bases that do not follow commands, in time and without false alarms."""

import dataclasses
from dataclasses import dataclass

import pytest
from executions import LIBRARY, ROBOT, chain
from faulty_base import Failure, KinematicBase, execute

from ator_ros.actions.base import Status, Step
from ator_ros.bases.differential.response import ramped
from ator_ros.domains.domain import find_domain
from ator_ros.domains.trials import random_trial
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.execution.chain_executor import ChainExecutor, Ending
from ator_ros.execution.fence import Fence, FenceWatch
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.geometry import Pose
from ator_ros.simulation.sensors import SensorConfig, Sensors
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.readers import robot_from_placement
from ator_ros.world.robot_velocity import RobotVelocity, TwistCheck
from ator_ros.world.state import STOP, Command, RobotState, World
from ator_ros.world.transforms import HERE, Placement, Transforms

SOCCER = find_domain("soccer")

TICK = 0.05
AHEAD = chain(("goToPose", Pose(4.0, 0.0, 0.0)))


def base(failure: Failure | None = None) -> KinematicBase:
    return KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0), failure=failure)


@pytest.mark.parametrize("since", [0.0, 0.15, 0.3, 1.0, 2.0])
def test_frozen_odometry_stops_the_robot_within_half_a_second(since: float) -> None:
    last = RobotState(Pose(0.0, 0.0, 0.0))

    def frozen(time: float, state: RobotState) -> RobotState:
        nonlocal last
        last = state if time <= since else last
        return last

    done = execute(LIBRARY, AHEAD, base(), sense=frozen)
    assert done.ending is Ending.BASE_FAULT
    assert "frozen" in done.execution.reason
    assert (
        max([time for time, state in done.states if not state.is_standing], default=0.0)
        <= since + 0.5
    )


@pytest.mark.parametrize("gap", [0.3, 0.7, 1.4, 1.6, 3.0])
def test_sparse_odometry_of_a_base_that_follows_is_no_fault(gap: float) -> None:
    watch = MotionWatch(ROBOT, 0.0)
    time = x = 0.0
    for number in range(40):
        state = RobotState(Pose(x, 0.0, 0.0), 0.3 if number else 0.0)
        assert watch.fault(time, state, time) is None
        watch.sent(time, Command(0.3))
        step = TICK if number % 4 else gap
        time += step
        x += 0.3 * step


@pytest.mark.parametrize(("axis", "speed"), [("vx", 0.6), ("w", 1.0), ("vx", -0.6)])
def test_a_base_that_moves_without_a_command_ends_the_goal(axis: str, speed: float) -> None:
    waits = chain(("goToBall", Pose(2.0, 0.0, 0.0)))  # at rest, for a ball
    done = execute(
        LIBRARY, waits, base(Failure("constant", axis, 0.5, "motion", speed)), longest=3.0
    )
    assert done.ending is Ending.BASE_FAULT
    verb = "moves" if axis == "vx" else "turns"
    assert f"{verb} although it was not commanded to" in done.execution.reason
    assert done.execution.executor.records == []
    assert 0.5 < done.ended <= 1.0


@pytest.mark.parametrize("share", [0.05, 0.12])
def test_odometry_that_shows_a_fraction_of_the_motion_is_detected_in_time(share: float) -> None:
    def shrunk(_: float, state: RobotState) -> RobotState:
        return RobotState(
            Pose(*(share * part for part in state.pose)), share * state.vx, share * state.w
        )

    done = execute(LIBRARY, AHEAD, base(), sense=shrunk)
    assert done.ending is Ending.BASE_FAULT
    assert "odometry" in done.execution.reason
    assert done.ended <= 0.5


def test_a_base_that_drives_on_after_its_goal_fails_the_goal() -> None:
    near = chain(("goToPose", Pose(1.0, 0.0, 0.0)))
    usual = execute(LIBRARY, near, base())
    assert usual.ending is Ending.SUCCEEDED
    end = usual.states[-1][0]
    runaway = base(Failure("constant", "vx", end - 0.4, "motion", 0.8))
    done = execute(LIBRARY, near, runaway, until_stood=False)
    assert done.ending is not Ending.SUCCEEDED


@pytest.mark.parametrize("share", [1.03, 1.05, 1.07, 1.1])
@pytest.mark.parametrize("goal", [Pose(4.0, 0.0, 0.0), Pose(2.0, 1.0, 1.0), Pose(1.0, -2.0, -2.0)])
def test_a_base_that_is_faster_than_commanded_arrives(share: float, goal: Pose) -> None:
    fast = KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0), share=share)
    done = execute(LIBRARY, chain(("goToPose", goal)), fast, rate=30.0)
    assert done.ending is Ending.SUCCEEDED, done.execution.reason


def test_it_is_said_that_a_base_is_faster_than_commanded() -> None:
    fast = KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0), share=1.07)
    done = execute(LIBRARY, AHEAD, fast, rate=30.0)
    assert done.watch.remark == "the base drives at about 107 % of the commanded speed"


@pytest.mark.parametrize("lag", [0.2, 0.3])
def test_a_twist_that_is_smoothed_ends_no_goal(lag: float) -> None:
    v, w, last = 0.0, 0.0, 0.0

    def smoothed(time: float, state: RobotState) -> RobotState:
        nonlocal v, w, last
        share = min(1.0, (time - last) / lag)
        v, w, last = v + share * (state.vx - v), w + share * (state.w - w), time
        return RobotState(state.pose, v, w)

    turns = chain(("goToPose", Pose(3.5, 1.0, 1.0)))
    done = execute(LIBRARY, turns, base(), rate=30.0, sense=smoothed)
    assert done.ending is Ending.SUCCEEDED, done.execution.reason


@pytest.mark.parametrize("rate", [20.0, 30.0, 50.0])
def test_wheels_that_slip_for_a_moment_end_no_goal(rate: float) -> None:
    """They turn as commanded while the pose, as of a filter, is constant for 0.3 s."""
    before = shown = Pose(0.0, 0.0, 0.0)

    def slips(time: float, state: RobotState) -> RobotState:
        nonlocal before, shown
        moved, before = before.relative(state.pose), state.pose
        shown = shown if 2.0 <= time < 2.295 else shown.compose(moved)
        return RobotState(shown, state.vx, state.w)

    done = execute(LIBRARY, AHEAD, base(), rate=rate, sense=slips)
    assert done.ending is Ending.SUCCEEDED, done.execution.reason


@pytest.mark.parametrize("rate", [20.0, 25.0, 50.0])
@pytest.mark.parametrize("since", [0.5, 1.0, 1.3, 1.5])
def test_a_base_that_swings_as_its_velocity_has_the_wrong_sign_is_stopped(
    rate: float, since: float
) -> None:
    """Each new plan starts at the measured speed, so the robot is commanded to and fro."""
    flipped = base(Failure("reversed", "vx", since, "motion"))
    done = execute(LIBRARY, AHEAD, flipped, rate=rate)
    assert done.ending is Ending.BASE_FAULT
    assert done.ended is not None
    assert done.ended <= since + 0.5


@pytest.mark.parametrize("rate", [20.0, 50.0])
@pytest.mark.parametrize(
    "share", [(0.0, 0.0), (1.0, 57.3), (57.3, 57.3), (0.1, 1.0), (0.1, 0.1), (1.0, -1.0)]
)
def test_where_the_twist_contradicts_the_pose_the_pose_decides(
    rate: float, share: tuple[float, float]
) -> None:
    """It is always zero, in degrees, a tenth, or of the wrong sign; one warning names it."""
    check, remarks = TwistCheck(), list[str]()

    def checked(time: float, state: RobotState) -> RobotState:
        twist = share[0] * state.vx, share[1] * state.w
        robot, remark = check.check(time, RobotState(state.pose, *twist))
        remarks.extend([remark] * bool(remark))
        return robot

    for goal in (Pose(2.5, 0.5, 1.0), Pose(-1.0, 0.5, 2.0)):
        done = execute(LIBRARY, chain(("goToPose", goal)), base(), rate=rate, sense=checked)
        assert done.ending is Ending.SUCCEEDED, done.execution.reason
    (remark,) = remarks
    assert remark.startswith("pose and twist.")
    assert "contradict each other" in remark


def test_a_base_that_does_not_turn_is_stopped_although_its_twist_is_zero() -> None:
    check = TwistCheck()
    done = execute(
        LIBRARY,
        chain(("goToPose", Pose(0.0, 0.0, 2.5))),
        base(Failure("stuck", "w", 0.5, "motion")),
        sense=lambda time, state: check.check(time, RobotState(state.pose))[0],
        longest=3.0,
    )
    assert done.ending is Ending.BASE_FAULT
    assert done.ended is not None
    assert done.ended <= 1.0


@pytest.mark.parametrize(
    ("latency", "goal"),
    [
        (0.2, Pose(1.0, -2.0, -2.0)),
        (0.22, Pose(1.0, -2.0, -2.0)),
        (0.25, Pose(1.0, -2.0, -2.0)),
        (0.25, Pose(4.0, 0.0, 0.0)),
    ],
)
def test_a_base_that_is_later_than_described_is_called_late(latency: float, goal: Pose) -> None:
    """It arrives or is stopped."""
    late = KinematicBase(ROBOT, Pose(0.0, 0.0, 0.0), latency=latency)
    done = execute(LIBRARY, chain(("goToPose", goal)), late, rate=30.0)
    assert done.ending in (Ending.SUCCEEDED, Ending.BASE_FAULT)
    for text in (done.watch.remark, done.watch.cause):
        assert "reacts later than `latency` 0 s: raise it" in text


def test_a_base_that_is_stuck_is_not_called_late() -> None:
    for since in (0.0, 0.5, 1.5):
        stuck = base(Failure("stuck", "vx", since, "motion"))
        done = execute(LIBRARY, AHEAD, stuck, rate=30.0)
        assert done.ending is Ending.BASE_FAULT
        assert "does not move as commanded" in done.execution.reason
        assert done.watch.cause == ""


@dataclass(frozen=True)
class Kind:
    """How a base and its odometry differ from the described robot."""

    drift: float = 0.0  # m after 1 m; of the heading, half as many rad
    latency: float = 0.0  # s
    motor_lag: float = ROBOT.motor_time_constant  # s
    dead_zone: Command = STOP  # speeds up to which a command does nothing
    share: float = 1.0  # of the commanded speed

    def response(self, command: Command) -> Command:
        """Return the command that a base as described follows in the same way."""
        v = 0.0 if abs(command.vx) <= self.dead_zone.vx else self.share * command.vx
        w = 0.0 if abs(command.w) <= self.dead_zone.w else self.share * command.w
        return Command(v, w)


KINDS = {
    "as described": Kind(),
    "late": Kind(drift=0.02, latency=0.1),
    "noisy": Kind(drift=0.02),
    "motor lag": Kind(motor_lag=0.15),
    "dead zone": Kind(dead_zone=Command(0.05, 0.1)),
    "half as fast": Kind(share=0.5),
}


class Watched(ChainExecutor):
    """Executes a chain on a kind of base; keeps the faults of motion watch and fence.

    They are kept until the robot collides: it decelerates five times as fast as it can brake. With
    the paper's actions, a base with slow motors may hit a goal post.
    """

    def __init__(
        self, library: TopLibrary, chain: TopChain, kind: Kind, fence: Fence, seed: int
    ) -> None:
        super().__init__(library, chain)
        self._sensors = Sensors(SensorConfig(kind.drift, 0.5 * kind.drift, kind.latency), seed)
        self._watch, self._last = MotionWatch(ROBOT, kind.latency and kind.latency + TICK), -1.0
        self._kind, self._fence = kind, FenceWatch(fence, ROBOT, 0.5)
        self._speed, self.collided = 0.0, False
        self.faults: set[str] = set()

    def step(self, world: World) -> Step:
        speed = abs(world.robot.vx)
        self.collided |= self._speed - speed > 5.0 * ROBOT.limits.brake * TICK
        self._speed = speed
        observed = self._sensors.observe(world)
        if observed.time == self._last:
            return Step(None, Status.RUNNING, "")
        self._last = observed.time
        ahead = self._watch.foresight.ahead(observed)
        faults = (
            self._watch.fault(observed.time, observed.robot, world.time),
            self._fence.fault(ahead, self.call),
        )
        if not self.collided:
            self.faults |= {fault for fault in faults if fault}
        step = super().step(ahead)
        self._watch.sent(observed.time, step.command)
        return dataclasses.replace(step, command=self._kind.response(step.command or STOP))


@pytest.mark.long
@pytest.mark.parametrize("action_set", ["default", "bezier"])
@pytest.mark.parametrize("name", KINDS)
def test_a_fault_is_raised_in_many_chains_only_where_there_is_one(
    name: str, action_set: str
) -> None:
    kind, library = KINDS[name], SOCCER.library(ROBOT, action_set)
    moved = dataclasses.replace(ROBOT, motor_time_constant=kind.motor_lag)
    # The paper's actions ignore the field and may leave it.
    fence = Fence.around(ROBOT) if action_set == "default" else Fence(-50.0, -50.0, 50.0, 50.0)
    faults = {}
    for index in range(100, 130):
        trial = random_trial(
            SOCCER, ("dribble", "shoot")[index % 2], library, seed=902, index=index
        )
        executor = Watched(library, trial.chain, kind, fence, index)
        run_chain(moved, library, trial.world, trial.chain, executor=executor)
        faults |= {index: executor.faults} if executor.faults else {}
    # The paper's actions creep at 0.04 m/s, which a base with a dead zone truly does not follow.
    assert bool(faults) is ((name, action_set) == ("dead zone", "bezier")), faults


def test_motion_before_the_goal_is_ignored() -> None:
    watch = MotionWatch(ROBOT, 0.0)
    for tick in range(40):  # pushed by hand
        watch.fault(tick * TICK, RobotState(Pose(0.04 * tick, 0.0, 0.0), 0.8), tick * TICK)
        if tick == 20:
            watch.reset()
    watch.reset()
    assert watch.fault(2.0, RobotState(Pose(1.6, 0.0, 0.0), 0.8), 2.0) is None
    assert watch.fault(2.05, RobotState(Pose(1.64, 0.0, 0.0), 0.8), 2.05) is None


@pytest.mark.parametrize("preempts", [True, False])
def test_commands_in_transit_count_when_another_goal_takes_over(preempts: bool) -> None:
    """They reach the base before the stop command of the newer goal, which has the same latency."""
    latency, v, x = 0.5, 0.0, 0.0
    watch, sent, faults = MotionWatch(ROBOT, latency), [], []
    for tick in range(40):
        time = tick * TICK
        faults.append(watch.fault(time, RobotState(Pose(x, 0.0, 0.0), v), time))
        if tick == 9:  # the base does not move yet
            watch.begin(latency, preempts=preempts)
        sent.append(Command(0.8, 0.0) if tick < 9 else STOP)
        watch.sent(time, sent[-1])
        acting = sent[tick - 10] if tick >= 10 else STOP
        v = ramped(Command(v, 0.0), acting, TICK, ROBOT.limits, ROBOT.stop).vx
        x += v * TICK
    assert any(faults) is not preempts


def fault_of_coasting(deceleration: float) -> str | None:
    """Return the fault of a base that is to stop at full speed and decelerates by this (m/s^2)."""
    watch, x, v, fault = MotionWatch(ROBOT, 0.0), 0.0, ROBOT.limits.v, None
    for tick in range(80):
        fault = fault or watch.fault(tick * TICK, RobotState(Pose(x, 0.0, 0.0), v), tick * TICK)
        watch.sent(tick * TICK, STOP)
        v = max(0.0, v - deceleration * TICK)
        x += v * TICK
    return fault


def test_a_base_may_brake_at_half_its_described_deceleration() -> None:
    assert fault_of_coasting(0.5 * ROBOT.limits.brake) is None
    assert "not commanded to" in (fault_of_coasting(0.0) or "")


STANDING = RobotState(Pose(0.0, 0.0, 0.0))


@pytest.mark.parametrize("rate", [20, 50, 200])
def test_a_frozen_pose_that_jitters_is_still_frozen(rate: int) -> None:
    watch, period, fault = MotionWatch(ROBOT, 0.0), 1.0 / rate, None
    for tick in range(rate):
        time = tick * period
        watch.sent(time - period, Command(1.0, 0.0))
        pose = Pose(1.0 + 0.004 * (tick % 2), 0.0, 0.0)
        fault = watch.fault(time, RobotState(pose, 1.0, 0.0), time)
        if fault:
            assert time <= 0.5
            break
    assert "odometry is frozen" in (fault or "")


@pytest.mark.parametrize("rate", [2.0, 3.0, 5.0, 10.0])
def test_odometry_frozen_at_rest_is_detected_at_any_rate(rate: float) -> None:
    watch, fault, tick = MotionWatch(ROBOT, 0.0), None, 0
    while fault is None:
        time = tick / rate
        fault = watch.fault(time, STANDING, time)
        watch.sent(time, Command(0.5, 0.0))
        tick += 1
        assert time <= 0.5
    assert "the base does not move" in fault


def test_low_rate_odometry_of_a_late_base_raises_no_fault() -> None:
    for rate in (2.0, 3.0, 5.0):
        watch, v, x = MotionWatch(ROBOT, 0.0), 0.0, 0.0
        for tick in range(int(3.0 * rate)):
            time = tick / rate
            assert watch.fault(time, RobotState(Pose(x, 0.0, 0.0), v), time) is None
            watch.sent(time, Command(0.5, 0.0))
            for step in range(100):  # 0.1 s late, at half the acceleration
                late = time + step / rate / 100.0 > 0.1
                v = min(0.5, v + 0.5 * ROBOT.limits.a / rate / 100.0) if late else 0.0
                x += v / rate / 100.0


def test_a_delayed_command_counts_from_when_it_was_sent() -> None:
    """After a delay of the executor, the base has not yet received the command."""
    watch = MotionWatch(ROBOT, 0.0)
    assert watch.fault(0.0, STANDING, 0.0) is None
    watch.sent(0.0, Command(0.09, 0.0), 0.29)
    assert watch.fault(0.30, STANDING, 0.3) is None
    for tick in range(7, 13):  # a base that never moves is still a fault
        watch.sent(TICK * (tick - 1), Command(0.09, 0.0), TICK * (tick - 1))
        fault = watch.fault(TICK * tick, STANDING, TICK * tick)
    assert "the base does not move" in (fault or "")


@pytest.mark.parametrize("in_odometry", [True, False])
def test_corrections_of_the_pose_in_tf_are_not_motion(in_odometry: bool) -> None:
    """A localization shifts odometry's frame by 5 cm twice a second, dated ahead as by AMCL."""
    known, estimate, watch = Transforms(), RobotVelocity(1.2, 2.4), MotionWatch(ROBOT, 0.0)
    faults: set[str | None] = set()
    for tick in range(100):
        time = TICK * tick
        if tick % 10 == 0:
            origin = 0.05 * (tick // 10 % 2), 0.0, 0.0
            known.add("map", "odom", time + 1.0, Placement(origin, HERE.turn))
        known.add("odom", "base_link", time, HERE)
        found = known.latest("map", "base_link")
        if found is None or tick < 20:
            continue
        moved = known.latest_in_odometry("map", "base_link") if in_odometry else None
        _, robot = robot_from_placement(estimate, *found, moved)
        faults.add(watch.fault(time, robot, time))
        watch.sent(time, STOP, time)
    assert (faults == {None}) is in_odometry
