"""The motion watch alone, fed with states one by one: what it notices, and what it lets pass."""

from __future__ import annotations

import math

import pytest
from executions import ROBOT

from ator_ros.execution.motion_watch import MotionWatch
from ator_ros.geometry import Pose
from ator_ros.world.state import STOP, Command, RobotState

TICK = 0.05
STANDING = RobotState(Pose(0.0, 0.0, 0.0))


def test_a_pose_in_a_bend_is_not_frozen() -> None:
    watch = MotionWatch(ROBOT, 0.0)
    for tick in range(100):
        angle = tick * TICK
        pose = Pose(math.sin(angle), 1.0 - math.cos(angle), angle)
        watch.sent(tick * TICK, Command(1.0, 1.0))
        assert watch.fault(tick * TICK, RobotState(pose, 1.0, 1.0), tick * TICK) is None


@pytest.mark.parametrize("rate", [20, 50, 200])
def test_a_frozen_pose_that_jitters_is_still_frozen(rate: int) -> None:
    watch, period, said = MotionWatch(ROBOT, 0.0), 1.0 / rate, None
    for tick in range(rate):
        time = tick * period
        watch.sent(time - period, Command(1.0, 0.0))
        pose = Pose(1.0 + 0.004 * (tick % 2), 0.0, 0.0)
        said = watch.fault(time, RobotState(pose, 1.0, 0.0), time)
        if said:
            assert time < 0.4
            break
    assert "odometry is frozen" in (said or "")


def test_odometry_at_5_hz_blames_no_base_that_stands_between_two_messages() -> None:
    watch = MotionWatch(ROBOT, 0.0)
    for tick in range(20):
        time = 0.2 * tick
        state = STANDING  # it has hardly begun to move when it is stopped again
        assert watch.fault(time, state, time) is None
        watch.sent(time, Command(0.5, 0.0))
        watch.sent(time + 0.15, STOP)


def test_a_base_a_third_as_strong_as_described_is_not_called_weak() -> None:
    watch, v, x = MotionWatch(ROBOT, 0.0), 0.0, 0.0
    for tick in range(200):
        target = ROBOT.limits.v * (-1.0 if 80 <= tick < 140 else 1.0) / 3.0
        v += max(-1.0, min(1.0, (target - v) / (ROBOT.limits.a * TICK / 3.0))) * ROBOT.limits.a * TICK / 3.0
        x += v * TICK
        assert watch.fault(tick * TICK, RobotState(Pose(x, 0.0, 0.0), v), tick * TICK) is None
        watch.sent(tick * TICK, Command(3.0 * target, 0.0))


@pytest.mark.parametrize("rate", [2.0, 3.0, 5.0, 10.0])
def test_odometry_that_froze_while_standing_is_noticed_however_rarely_it_comes(rate: float) -> None:
    watch, said, tick = MotionWatch(ROBOT, 0.0), None, 0
    while said is None:
        time = tick / rate
        said = watch.fault(time, STANDING, time)
        watch.sent(time, Command(0.5, 0.0))
        tick += 1
        assert time <= 0.5
    assert "the base does not move" in said


def test_rare_odometry_does_not_accuse_a_late_base() -> None:
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


def test_a_command_that_left_late_counts_from_then() -> None:
    """The executor was busy: its answer to a state meets a base that knows nothing of it yet."""
    watch = MotionWatch(ROBOT, 0.0)
    assert watch.fault(0.0, STANDING, 0.0) is None
    watch.sent(0.0, Command(0.09, 0.0), 0.29)
    assert watch.fault(0.30, STANDING, 0.3) is None
    for tick in range(7, 13):  # which does not excuse one that stands for good
        watch.sent(TICK * (tick - 1), Command(0.09, 0.0), TICK * (tick - 1))
        said = watch.fault(TICK * tick, STANDING, TICK * tick)
    assert "the base does not move" in (said or "")


def test_a_base_that_stood_by_itself_for_want_of_commands_is_not_accused() -> None:
    watch = MotionWatch(ROBOT, 0.0)
    assert watch.fault(0.0, STANDING, 0.0) is None
    watch.sent(0.0, Command(0.09, 0.0), 0.0)
    assert watch.fault(1.2, RobotState(Pose(0.04, 0.0, 0.0)), 1.2) is None
    watch.sent(1.2, Command(0.5, 0.0), 1.2)
    assert watch.fault(2.4, RobotState(Pose(0.0401, 0.0, 0.0), 0.2), 2.4) is None  # it has just begun


@pytest.mark.parametrize("rate", [4, 5, 20])
def test_wheels_that_are_blocked_at_once_are_not_called_frozen_odometry(rate: int) -> None:
    watch, said, tick = MotionWatch(ROBOT, 0.0), None, 0
    while said is None:
        time = tick / rate
        moved = min(time, 1.0)
        state = RobotState(Pose(moved, 0.0, 0.0), 1.0 if time <= 1.0 else 0.0)
        said = watch.fault(time, state, time)
        watch.sent(time, Command(1.0, 0.0), time)
        tick += 1
        assert time <= 1.75
    assert "the base does not move" in said
