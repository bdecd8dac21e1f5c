"""Bases that do not follow commands are stopped within 0.5 s.

Slow and noisy bases raise no fault.
"""

import dataclasses
import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from faulty_base import Failure, Goal, KinematicBase, execute
from selection import few

from ator_ros.actions.base import Goal as ActionGoal
from ator_ros.bases.description import Robot, load_robot
from ator_ros.bases.differential.limits import Limits
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.resources import resource_path
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import Command, ObjectState, RobotState

LONG_CAUSE = (
    "odometry describes a point about 0.10 m to the left of the axle's middle (`calibrate` "
    "measures it)"
)
PIONEER, TURTLEBOT, HEAVY = (
    load_robot(resource_path("config", f"{name}.yaml"))
    for name in ("pioneer", "turtlebot4", "pioneer_lx")
)
CRAWLER = dataclasses.replace(
    TURTLEBOT, name="crawler", limits=Limits(v=0.05, w=0.3, a=0.1, brake=0.1, aw=0.6)
)
ROBOTS = {robot.name: robot for robot in (PIONEER, TURTLEBOT, HEAVY, CRAWLER)}
# s; the speeds of a base that fails and of one that follows, perhaps half as strong, then differ by
# what odometry shows, which takes a heavy base as much longer as it accelerates less
LONGEST = {"pioneer_lx": 0.5 * PIONEER.limits.a / HEAVY.limits.a}


def go(robot: Robot, pose: Pose) -> TopChain:
    top = SOCCER.library(robot)["goToPose"]
    return TopChain((TopCall(top, ActionGoal(pose, 0.0, top.point)),))


def goals(robot: Robot, speed: float) -> dict[str, Pose]:
    """Return goals for which the robot reaches a share of its maximum speed, or only turns."""
    limits = robot.limits
    distance = (speed * limits.v) ** 2 / min(limits.a, limits.brake) + 0.3 * limits.v
    distance = min(3.0, max(distance, 2.0 * limits.v, 0.1))
    return {
        "bend": Pose(distance, 0.5 * distance, 1.57),
        "ahead": Pose(distance, 0.0, 0.0),
        "turn": Pose(0.0, 0.0, 2.5 * speed),
    }


def moments(plain: Goal, robot: Robot) -> dict[str, float]:
    """Return the times in s at which a failure of the base starts."""
    fastest = max(abs(state.vx) for _, state in plain.states)

    def first(holds: Callable[[RobotState], bool]) -> float | None:
        return next((time for time, state in plain.states if holds(state)), None)

    found = {
        "start": 0.0,
        "driving": first(
            lambda state: fastest > 0.1 * robot.limits.v and abs(state.vx) > 0.8 * fastest
        ),
        "turning": first(lambda state: abs(state.w) > 0.4 * robot.limits.w),
        "near the goal": (plain.ended or 0.0) - 0.4,
    }
    return {when: time for when, time in found.items() if time is not None and time >= 0.0}


def failures(axis: str, limit: float, since: float) -> list[Failure]:
    kinds = [
        ("stuck", "command", 0.0), ("stuck", "motion", 0.0), ("stuck", "odometry", 0.0),
        ("reversed", "command", 0.0), ("reversed", "motion", 0.0),
        ("constant", "motion", 0.7 * limit), ("constant", "motion", -0.4 * limit),
        ("delayed", "command", 0.0), ("delayed", "motion", 0.0),
    ]  # fmt: skip
    return [Failure(kind, axis, since, place, value) for kind, place, value in kinds]


def stops(
    robot: Robot,
    speeds: tuple[float, ...],
    names: tuple[str, ...],
    places: tuple[str, ...] = ("command", "motion", "odometry"),
) -> dict[str, tuple[float, str]]:
    """Return for each failure the longest time in s from its first effect to the stop."""
    library, worst = SOCCER.library(robot), dict[str, tuple[float, str]]()
    for speed in speeds:
        for name in names:
            chain = go(robot, goals(robot, speed)[name])
            plain = execute(library, chain, KinematicBase(robot, Pose(0.0, 0.0, 0.0)))
            assert plain.ending is Ending.SUCCEEDED
            for when, since in moments(plain, robot).items():
                for axis in robot.axes:
                    for failure in failures(axis.name, axis.limit, since):
                        if failure.place not in places:
                            continue
                        base = KinematicBase(robot, Pose(0.0, 0.0, 0.0), failure=failure)
                        done = execute(library, chain, base, longest=since + 6.0, until_stood=False)
                        key = f"{failure.kind} {axis.name} in {failure.place}"
                        case = (
                            f"{speed:g} {name} {when} {failure.value:.2f}: {done.execution.reason}"
                        )
                        worst[key] = max(worst.get(key, (0.0, "")), (done.late, case))
    return worst


def slow(robot: Robot, worst: dict[str, tuple[float, str]], most: float) -> str:
    """Return a table of the cases that took longer than `most` s."""
    late = {key: value for key, value in worst.items() if value[0] > most + 1e-6}
    return "\n".join(
        f"{robot.name} {key}: {time:.2f} s, {case}" for key, (time, case) in late.items()
    )


def test_a_base_that_fails_on_one_axis_is_stopped_within_half_a_second() -> None:
    assert slow(PIONEER, stops(PIONEER, (1.0,), ("bend",), ("motion",)), 0.5) == ""


@pytest.mark.parametrize("since", [0.6, 1.0, 1.5, 2.0, 3.0])
def test_a_base_that_keeps_driving_is_stopped_although_plans_start_at_its_speed(
    since: float,
) -> None:
    failure = Failure("constant", "vx", since, "motion", 0.8)
    base = KinematicBase(PIONEER, Pose(-2.0, 0.0, 0.0), failure=failure)
    chain = go(PIONEER, Pose(2.0, 1.0, 0.0))
    done = execute(
        SOCCER.library(PIONEER), chain, base, rate=25.0, longest=since + 3.0, until_stood=False
    )
    assert done.ending is Ending.BASE_FAULT
    assert done.ended - since <= 0.5


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_each_failure_is_detected_at_each_moment(name: str) -> None:
    robot = ROBOTS[name]
    worst = stops(robot, (0.5, 1.0), ("bend", "ahead", "turn"))
    for key, (time, case) in sorted(worst.items()):
        print(f"{name} {key:22} {time:.2f} s  {case[:90]}")
    assert slow(robot, worst, LONGEST.get(name, 0.5)) == ""


def test_a_dribbling_base_that_stops_turning_is_stopped() -> None:
    library = SOCCER.library(PIONEER)
    top = library["dribbleBall"]
    chain = TopChain((TopCall(top, ActionGoal(Pose(1.5, 1.0, 1.57), 0.0, top.point)),))
    ball = {BALL: ObjectState(PIONEER.hold, 0.0)}
    for axis, kind in (("w", "stuck"), ("vx", "stuck"), ("vx", "reversed")):
        base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0), failure=Failure(kind, axis, 0.0))
        done = execute(library, chain, base, objects=lambda _: ball, longest=4.0, until_stood=False)
        assert done.ended is not None
        assert done.late <= 0.5


def noisy(seed: int) -> Callable[[float, RobotState], RobotState]:
    rng = np.random.default_rng(seed)

    def sense(_: float, state: RobotState) -> RobotState:
        x, y, yaw = state.pose
        pose = Pose(
            x + rng.normal(0.0, 0.005),
            y + rng.normal(0.0, 0.005),
            wrap_angle(yaw + rng.normal(0.0, math.radians(0.5))),
        )
        return RobotState(pose, state.vx + rng.normal(0.0, 0.02), state.w + rng.normal(0.0, 0.02))

    return sense


SLOWER = {
    "as described": {},
    "lag": {"lag": 2.0},
    "dead band": {"dead_band": Command(0.02, 0.05)},
    "weak": {"strength": 0.5},
    "late": {"latency": 0.1},
    "half speed": {"share": 0.5},
}
ODOMETRY = {
    "exact": (20.0, 0.0, 0.0),
    "rare": (10.0, 0.2, 0.0),
    "rarest": (8.0, 0.1, 0.0),
    "lossy": (10.0, 0.2, 0.05),
    "dense": (100.0, 0.3, 0.05),
}


@pytest.mark.parametrize("noise", few([False, True], True))
@pytest.mark.parametrize("odometry", few(ODOMETRY, "exact", "lossy"))
@pytest.mark.parametrize("kind", SLOWER)
def test_a_base_that_follows_raises_no_fault(kind: str, odometry: str, noise: bool) -> None:
    rate, jitter, dropped = ODOMETRY[odometry]
    if noise and odometry == "lossy":
        dropped = 0.0  # two messages 0.2 s apart contain too little information
    for robot in (PIONEER, HEAVY):
        changed = dict(SLOWER[kind])
        if "lag" in changed:
            changed["lag"] = 2.0 * robot.motor_time_constant
        base = KinematicBase(robot, Pose(0.0, 0.0, 0.0), **changed)
        done = execute(
            SOCCER.library(robot), go(robot, Pose(1.0, -0.5, 2.5)), base,
            rate=rate, jitter=jitter, dropped=dropped,
            latency=0.1 if kind == "late" else 0.0, longest=25.0,
            **({"sense": noisy(1)} if noise else {}),
        )  # fmt: skip
        assert done.ending is not Ending.BASE_FAULT, done.execution.reason


@pytest.mark.parametrize("share", [0.35, 0.45])
def test_a_slow_base_is_not_called_late_before_its_share_is_known(share: float) -> None:
    watch = MotionWatch(PIONEER, latency=0.0)
    pose, speed = Pose(0.0, 0.0, 0.0), 0.0
    for tick in range(60):  # it follows a plan that gains 0.8 m/s^2
        watch.fault(0.05 * tick, RobotState(pose, speed, 0.0), 0.05 * tick)
        assert "latency" not in watch.remark
        command = Command(min(0.04 * tick, 1.2), 0.0)
        watch.sent(0.05 * tick, command, 0.05 * tick)
        speed = share * command.vx
        pose = pose.ahead(0.05 * speed)
    assert "description is implausible" in watch.remark


@pytest.mark.parametrize("name", ["pioneer_3dx", "turtlebot4", "pioneer_lx"])
@pytest.mark.parametrize("share", [0.5, 0.6])
def test_a_base_slower_than_described_arrives_late_and_is_named(name: str, share: float) -> None:
    robot = ROBOTS[name]
    for pose in (Pose(3.5, 0.0, 0.0), Pose(-2.0, 0.5, 0.0)):
        base = KinematicBase(robot, Pose(0.0, 0.0, 0.0), share=share)
        done = execute(SOCCER.library(robot), go(robot, pose), base)
        assert done.ending is Ending.SUCCEEDED, done.execution.reason
        assert f"drives at about {100 * share:.0f} % of the commanded speed" in done.watch.remark


@pytest.mark.parametrize("since", [0.5, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("axis", ["vx", "w"])
def test_a_base_that_drops_to_half_speed_raises_no_fault(axis: str, since: float) -> None:
    for pose in (Pose(4.0, 1.0, 0.0), Pose(2.0, 1.0, 1.57)):
        base = KinematicBase(
            PIONEER, Pose(0.0, 0.0, 0.0), failure=Failure("half", axis, since, "motion")
        )
        done = execute(SOCCER.library(PIONEER), go(PIONEER, pose), base, longest=25.0)
        assert done.ending is not Ending.BASE_FAULT, done.execution.reason


def test_a_canceled_goal_reports_that_the_base_still_moves() -> None:
    base = KinematicBase(
        PIONEER, Pose(0.0, 0.0, 0.0), failure=Failure("constant", "vx", 1.5, "motion", 0.8)
    )
    done = execute(
        SOCCER.library(PIONEER), go(PIONEER, Pose(3.0, 0.0, 0.0)), base, cancel=1.55,
    )  # fmt: skip
    assert done.ending is Ending.CANCELED
    assert "canceled by the client; the robot still moves at 0.80 m/s and" in done.execution.reason
    assert all(command == Command() for command in done.commands[-95:])  # for 5 s


@pytest.mark.parametrize("rate", [20.0, 50.0])
@pytest.mark.parametrize("latency", [0.0, 0.1])
@pytest.mark.parametrize("beyond", [0.06, 0.1])
def test_a_latency_that_is_set_a_little_too_high_raises_no_fault(
    rate: float, latency: float, beyond: float
) -> None:
    for pose in (Pose(2.0, 1.0, 1.57), Pose(0.0, 0.0, 2.5), Pose(0.4, 0.1, -0.5)):
        base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0), latency=latency)
        chain = go(PIONEER, pose)
        done = execute(SOCCER.library(PIONEER), chain, base, rate=rate, latency=latency + beyond)
        assert done.ending is Ending.SUCCEEDED, done.execution.reason


@pytest.mark.parametrize("rate", [20.0, 50.0])
@pytest.mark.parametrize(("latency", "named"), [(0.1, False), (0.15, False), (0.2, True)])
def test_a_latency_that_is_a_tenth_of_a_second_too_high_is_named(
    rate: float, latency: float, named: bool
) -> None:
    base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0), latency=0.1)
    chain = go(PIONEER, Pose(2.0, 1.0, 1.57))
    done = execute(SOCCER.library(PIONEER), chain, base, rate=rate, latency=latency)
    assert done.ending is Ending.SUCCEEDED
    assert ("the base reacts earlier" in done.watch.remark) is named


@pytest.mark.parametrize("share", [0.4, 0.6])
def test_a_base_that_is_slower_than_commanded_is_named_with_its_speed(share: float) -> None:
    base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0), share=share)
    done = execute(SOCCER.library(PIONEER), go(PIONEER, Pose(2.0, 0.0, 0.0)), base)
    assert done.ending in (Ending.SUCCEEDED, Ending.FAILED)
    assert f"at about {100 * share:.0f} % of the commanded speed" in done.watch.remark
    assert ("its description is implausible" in done.watch.remark) is (share < 0.55)
    assert "`latency`" not in done.watch.remark  # such a base only seems to be late


@pytest.mark.parametrize("rate", [20.0, 50.0])
def test_a_latency_that_is_set_far_too_high_is_named(rate: float) -> None:
    base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0))
    chain = go(PIONEER, Pose(2.0, 1.0, 1.57))
    done = execute(SOCCER.library(PIONEER), chain, base, rate=rate, latency=0.3)
    assert done.ending in (Ending.SUCCEEDED, Ending.BASE_FAULT)
    assert "the base reacts earlier than `latency` 0.3 s: lower it" in done.watch.remark


@pytest.mark.parametrize("axis", ["vx", "w"])
@pytest.mark.parametrize("kind", ["stuck", "reversed"])
def test_a_high_latency_does_not_hide_a_fault(axis: str, kind: str) -> None:
    failure = Failure(kind, axis, 1.0, "motion")
    base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0), latency=0.3, failure=failure)
    done = execute(
        SOCCER.library(PIONEER), go(PIONEER, Pose(2.0, 1.0, 1.57)), base, latency=0.3, longest=6.0,
    )  # fmt: skip
    assert done.ending is Ending.BASE_FAULT
    assert done.late <= 0.5
    assert "latency" not in done.execution.reason


@pytest.mark.parametrize("name", ["turtlebot4", "pioneer_lx"])
@pytest.mark.parametrize("axis", ["vx", "w"])
@pytest.mark.parametrize("kind", ["stuck", "reversed"])
def test_a_fault_of_a_base_with_slow_motors_is_not_called_a_delay(
    name: str, axis: str, kind: str
) -> None:
    robot = ROBOTS[name]
    for since in (0.4, 1.2, 2.4, 3.4):
        base = KinematicBase(
            robot, Pose(0.0, 0.0, 0.0), failure=Failure(kind, axis, since, "motion")
        )
        chain = go(robot, Pose(2.0, 1.0, 1.57))
        done = execute(SOCCER.library(robot), chain, base, longest=8.0, until_stood=False)
        assert done.ending is Ending.BASE_FAULT
        assert "latency" not in done.execution.reason


@pytest.mark.parametrize("rate", [20.0, 30.0])
@pytest.mark.parametrize("name", ["pioneer_3dx", "turtlebot4", "pioneer_lx"])
def test_a_base_as_described_is_called_neither_late_nor_slow_nor_fast(
    name: str, rate: float
) -> None:
    robot = ROBOTS[name]
    for pose in (Pose(2.0, 1.0, 1.57), Pose(3.5, 0.0, 0.0)):
        base = KinematicBase(robot, Pose(0.0, 0.0, 0.0))
        done = execute(SOCCER.library(robot), go(robot, pose), base, rate=rate)
        assert done.ending is Ending.SUCCEEDED
        assert done.watch.remark == ""


@pytest.mark.parametrize("name", ["pioneer_3dx", "turtlebot4", "pioneer_lx"])
@pytest.mark.parametrize("changed", [{"share": 0.8}, {"share": 0.9}, {"strength": 0.63}])
def test_a_base_that_is_a_little_slow_or_weak_is_not_called_late(
    name: str, changed: dict[str, float]
) -> None:
    robot = ROBOTS[name]
    base = KinematicBase(robot, Pose(0.0, 0.0, 0.0), **changed)
    done = execute(SOCCER.library(robot), go(robot, Pose(2.0, 1.0, 1.57)), base)
    assert done.ending is Ending.SUCCEEDED
    assert "latency" not in done.watch.remark


@pytest.mark.parametrize("late", [6, 7, 8, 10])
def test_a_fault_names_no_numbers_that_do_not_differ(late: int) -> None:
    """A base follows pulses `late` messages later, so commands and speeds may be equal."""
    watch, commands = MotionWatch(PIONEER, latency=0.0), list[Command]()
    pose, fault = Pose(0.0, 0.0, 0.0), None
    for tick in range(60):
        sent = commands[tick - late] if tick >= late else Command()
        pose, time = pose.ahead(0.05 * sent.vx), 0.05 * tick
        fault = watch.fault(time, RobotState(pose, sent.vx, 0.0), time)
        if fault is not None:
            break
        commands.append(Command(0.4 if tick % 10 < 7 else 0.0, 0.0))
        watch.sent(time, commands[-1], time)
    assert fault is not None
    pair = re.search(r"commanded to (.*), odometry show\w+ (.*? (?:rad|m)/s)", fault)
    assert pair is None or not pair[2].startswith(pair[1])


def test_a_base_that_drives_backward_slowly_is_not_said_to_refuse_it() -> None:
    base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0), share=0.19)
    done = execute(SOCCER.library(PIONEER), go(PIONEER, Pose(-1.5, 0.0, 0.0)), base, longest=6.0)
    assert done.ending is Ending.BASE_FAULT
    assert "v_back" not in done.execution.reason


def test_a_base_that_refuses_to_drive_backward_names_the_setting() -> None:
    failure = Failure("constant", "vx", 0.2, "motion", 0.0)
    base = KinematicBase(PIONEER, Pose(0.0, 0.0, 0.0), failure=failure)
    chain = go(PIONEER, Pose(-1.5, 0.0, 0.0))
    done = execute(SOCCER.library(PIONEER), chain, base, longest=6.0)
    assert done.ending is Ending.BASE_FAULT
    assert "set limits.v_back: 0 if it never drives backward" in done.execution.reason
    assert len(done.execution.reason) <= 300
    done.execution.explain(f"or {LONG_CAUSE}")
    assert "set limits.v_back: 0 if it never drives backward" in done.execution.reason
    assert done.execution.reason.endswith(f"; or {LONG_CAUSE}")
