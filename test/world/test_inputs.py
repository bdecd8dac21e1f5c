"""The executor node's inputs without ROS: odometry and ball, synchronized by stamp."""

import pytest

from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.geometry import Pose
from ator_ros.world.inputs import ClockJumpError, Inputs
from ator_ros.world.sightings import ObjectTracker, Sightings, StampError
from ator_ros.world.state import ObjectState, RobotState


def inputs() -> Inputs:
    return Inputs({BALL: Sightings(BALL, 0.3, ObjectTracker(0.0, 0.0))})


def test_the_ball_matches_the_stamp_of_odometry_in_any_order() -> None:
    both = inputs()
    both.object(BALL, 1.0, ObjectState(0.0, 0.0, 1.0, -2.0))
    both.object(BALL, 1.1, ObjectState(5.0, 5.0))
    joined = both.robot(1.05, RobotState(Pose(0.0, 0.0, 0.0)))
    assert (ball_of(joined).x, ball_of(joined).y) == pytest.approx((0.05, -0.1))


@pytest.mark.parametrize("factor", [1.0, 5.0])
def test_a_stamp_may_be_ahead_of_odometry_by_real_time(factor: float) -> None:
    both = inputs()
    for tick in range(100):
        both.robot(factor * 0.02 * tick, RobotState(Pose(0.0, 0.0, 0.0)), 0.02 * tick)
    newest = factor * 1.98
    both.object(BALL, newest + 0.5 * factor, ObjectState(0.0, 0.0), 1.98)
    for real in (2.0, 2.9):  # an idle node reads the ball before odometry of the same time
        assert both.object(BALL, newest + 0.7 * factor, ObjectState(0.0, 0.0), real) is None
    both.object(BALL, newest + 0.5 * factor, ObjectState(0.0, 0.0), 2.95)
    assert both.object(BALL, newest + 0.7 * factor, ObjectState(0.0, 0.0), 3.0) is None
    with pytest.raises(StampError, match="ahead"):
        both.object(BALL, newest + 0.7 * factor, ObjectState(0.0, 0.0), 4.0)


def test_a_ball_is_overdue_after_half_of_its_timeout() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    both.robot(1.0, robot)
    assert BALL in both.overdue  # none has arrived
    both.object(BALL, 0.9, ObjectState(0.0, 0.0))  # late, as from a camera, but received
    for time in (1.05, 1.1):
        both.robot(time, robot)
        assert BALL not in both.overdue
    both.robot(1.15, robot)
    assert BALL in both.overdue
    both.object(BALL, 1.15, ObjectState(0.0, 0.0))
    assert BALL not in both.overdue


@pytest.mark.parametrize("skew", [-0.2, 0.0, 0.2, 0.45, 0.5, 0.7, 1.9, 1e9])
def test_a_ball_with_a_clock_ahead_is_used_in_time_or_rejected(skew: float) -> None:
    both, robot, known, refused = inputs(), RobotState(Pose(0.0, 0.0, 0.0)), 0, 0
    for tick in range(1, 201):
        try:
            both.object(BALL, 0.05 * tick + skew, ObjectState(0.0, 0.0), 0.05 * tick)
        except StampError:
            refused += 1
        world = both.robot(0.05 * tick, robot)
        known += world is not None and ball_of(world) is not None and BALL not in both.overdue
    assert refused >= 179 if skew > 0.6 else refused == 0
    assert known <= 7 if skew > 0.6 else known >= 200 - 20 * abs(skew) - 1


def test_repeated_stamps_are_ignored_and_decreasing_stamps_are_errors() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    assert both.robot(1.0, robot) is not None
    assert both.robot(1.0, robot) is None
    assert both.robot(0.5, robot) is None
    with pytest.raises(ClockJumpError, match=r"after 1\.00 s, got 0\.55 s"):
        both.robot(0.55, robot)
    assert both.robot(0.6, robot) is not None


def test_one_late_message_is_ignored_and_many_are_reported() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    both.object(BALL, 1.0, ObjectState(0.0, 0.0))
    for stamp, now in (
        (1.0, 10.0),
        (1.1, 10.1),
        (1.05, 10.11),
        (1.15, 10.15),
        (2.3, 11.3),
        (2.25, 11.31),
    ):
        world = both.robot(stamp, robot, now)
        assert (world is None) == (stamp in (1.05, 2.25))
        assert both.time == (stamp if world else stamp + 0.05)
    assert both.robot(2.35, robot, 11.35) is not None
    with pytest.raises(
        StampError, match=r"odom\.header\.stamp: expected after 2\.35 s, got 2\.32 s"
    ):
        both.robot(2.32, robot, 11.36)
    assert both.robot(2.4, robot, 11.4) is not None  # the clock is unchanged


HOUR = 3600.0


def test_stamps_an_hour_ahead_are_a_jump_ahead_and_then_one_back() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    both.robot(1.0, robot)
    with pytest.raises(StampError):
        both.robot(1.05 + HOUR, robot)
    with pytest.raises(
        ClockJumpError, match=r"time jumped 3600\.10 s ahead: .* after 1\.00 s, got 3601\.10 s"
    ):
        both.robot(1.1 + HOUR, robot)
    assert both.robot(1.15 + HOUR, robot) is not None
    assert both.robot(1.2, robot) is None
    with pytest.raises(ClockJumpError, match=r"time went back 3599\.90 s"):
        both.robot(1.25, robot)
    assert both.robot(1.3, robot) is not None


def test_a_ball_with_a_late_clock_is_reported_except_after_a_reset() -> None:
    both, robot, errors = inputs(), RobotState(Pose(0.0, 0.0, 0.0)), []
    both.robot(HOUR, robot)
    both.object(BALL, 0.0, ObjectState(0.0, 0.0), 0.0)  # the first after a reset, before odometry
    for tick in range(1, 60):
        both.robot(HOUR + 0.05 * tick, robot)
        try:
            both.object(BALL, 0.05 * tick, ObjectState(0.0, 0.0), 0.05 * tick)
        except StampError as error:
            errors.append(str(error))
    assert 30 < len(errors) < 45
    assert "3600.00 s behind: another clock" in errors[0]


def test_each_object_has_its_own_timeout() -> None:
    names, robot = ("ball", "cup"), RobotState(Pose(0.0, 0.0, 0.0))
    both = Inputs({name: Sightings(name, 0.3, ObjectTracker(0.0, 0.0)) for name in names})
    both.robot(1.0, robot)
    assert both.overdue == {"ball", "cup"}
    both.object("ball", 1.0, ObjectState(1.0, 0.0))
    both.object("cup", 1.0, ObjectState(2.0, 0.0))
    assert both.overdue == frozenset()
    both.robot(1.2, robot)
    both.object("cup", 1.2, ObjectState(2.0, 0.0))
    joined = both.robot(1.4, robot)
    assert joined.objects == {"cup": ObjectState(2.0, 0.0)}
    assert both.overdue == {"ball", "cup"}
    assert both.object("cup", 9.0, ObjectState(0.0, 0.0)) is None
    with pytest.raises(StampError, match=r"^cup\.header\.stamp"):
        both.object("cup", 9.0, ObjectState(0.0, 0.0), 1.0)
    assert both.robot(0.0, robot) is None
    with pytest.raises(ClockJumpError):
        both.robot(0.05, robot)
    after = both.robot(0.1, robot)
    assert after.objects == {}


@pytest.mark.parametrize("rate", [4.0, 1.0, 0.5, 0.2, 0.02])
def test_fast_stamps_are_noticed_and_slow_ones_extend_real_timeouts(rate: float) -> None:
    both = inputs()
    for tick in range(60):
        both.robot(1.0 + 0.05 * tick, RobotState(Pose(0.0, 0.0, 0.0)), 7.0 + 0.05 * tick / rate)
    assert both.is_fast is (rate > 1.0)
    assert both.slowdown == pytest.approx(max(1.0, 1.0 / rate))
    assert rate > 0.5 or both.since <= 7.0 + 0.05 / rate  # messages with this period are not a gap


STANDING = RobotState(Pose(0.0, 0.0, 0.0))


def driven(both: Inputs, pace: float, seconds: float, *, start: tuple[float, float]) -> None:
    """Send odometry every 0.05 real s, whose stamps run `pace` times as fast."""
    stamp, real = start
    for tick in range(round(seconds / 0.05) + 1):
        both.robot(stamp + pace * 0.05 * tick, STANDING, real + 0.05 * tick)


def test_the_pace_is_that_of_the_last_two_seconds() -> None:
    both = inputs()
    driven(both, 1.0, 5.0, start=(0.0, 10.0))
    assert both.pace == pytest.approx(1.0)
    driven(both, 3.0, 1.0, start=(5.15, 15.05))
    assert 1.5 < both.pace < 2.5
    driven(both, 3.0, 1.5, start=(8.3, 16.1))
    assert both.pace == pytest.approx(3.0, rel=0.05)


def test_the_pace_is_measured_over_half_a_second() -> None:
    both = inputs()
    driven(both, 4.0, 0.45, start=(0.0, 10.0))
    assert both.pace == 1.0
    driven(both, 4.0, 0.1, start=(2.0, 10.5))
    assert both.pace == pytest.approx(4.0, rel=0.1)


def test_a_paused_simulation_keeps_its_pace() -> None:
    both = inputs()
    driven(both, 1.0, 3.0, start=(0.0, 10.0))
    driven(both, 1.0, 0.4, start=(3.05, 500.0))
    assert both.pace == pytest.approx(1.0)
    driven(both, 1.0, 2.0, start=(3.5, 500.45))
    assert both.pace == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("pace", "slowdown", "is_fast"),
    [
        (0.015, 50.0, False),
        (0.7, 1.0 / 0.7, False),
        (0.85, 1.0, False),
        (1.4, 1.0, False),
        (1.6, 1.0, True),
    ],
)
def test_timeouts_grow_with_slow_stamps(pace: float, slowdown: float, is_fast: bool) -> None:
    both = inputs()
    driven(both, pace, 4.0, start=(0.0, 10.0))
    assert both.slowdown == pytest.approx(slowdown)
    assert both.is_fast is is_fast


@pytest.mark.parametrize(
    ("gap", "ahead", "is_used"),
    [
        (0.0, 19.9, True),
        (0.0, 20.1, False),
        (0.5, 519.0, True),
        (0.5, 521.0, False),
        (9.0, 1019.0, True),
        (9.0, 1021.0, False),
    ],
)
def test_stamps_may_advance_a_thousand_times_as_fast_as_real_time(
    gap: float, ahead: float, is_used: bool
) -> None:
    both = inputs()
    both.robot(1.0, STANDING, 10.0)
    if is_used:
        assert both.robot(1.0 + ahead, STANDING, 10.0 + gap) is not None
        assert both.time == 1.0 + ahead
    else:
        with pytest.raises(StampError, match=f"got {1.0 + ahead:.2f} s, {ahead:.2f} s ahead"):
            both.robot(1.0 + ahead, STANDING, 10.0 + gap)
        assert both.time == 1.0


def test_odometry_has_arrived_since_the_last_gap_of_a_second() -> None:
    both = inputs()
    assert both.since < 0.0
    driven(both, 1.0, 2.0, start=(0.0, 10.0))
    assert both.since == 10.0
    both.robot(2.9, STANDING, 12.95)
    assert both.since == 10.0
    both.robot(4.0, STANDING, 14.0)
    assert both.since == 14.0


@pytest.mark.parametrize(("pause", "is_reported"), [(0.9, True), (1.1, False)])
def test_late_messages_are_reported_if_another_came_within_a_second(
    pause: float, is_reported: bool
) -> None:
    both = inputs()
    both.robot(1.0, STANDING, 10.0)
    assert both.robot(0.9, STANDING, 10.01) is None
    both.robot(1.1, STANDING, 10.1)
    if is_reported:
        with pytest.raises(StampError, match="arrive out of order"):
            both.robot(1.0, STANDING, 10.01 + pause)
    else:
        assert both.robot(1.0, STANDING, 10.01 + pause) is None


def test_timeouts_of_objects_are_set_by_name() -> None:
    both = inputs()
    both.robot(1.0, STANDING)
    both.object(BALL, 1.0, ObjectState(0.0, 0.0))
    both.set_timeouts({"cup_timeout": 9.0})
    both.robot(1.2, STANDING)
    assert both.overdue == {BALL}
    both.set_timeouts({f"{BALL}_timeout": 2.0})
    assert both.overdue == frozenset()


def test_a_reset_forgets_objects_and_delay() -> None:
    both = inputs()
    driven(both, 1.0, 4.0, start=(100.0, 10.0))
    both.object(BALL, 104.0, ObjectState(0.0, 0.0), 14.0)
    assert both.delay.is_known
    assert both.robot(5.0, STANDING, 14.05) is None
    with pytest.raises(ClockJumpError):
        both.robot(5.05, STANDING, 14.1)
    assert not both.delay.is_known
    assert both.time == 5.05
    after = both.robot(5.1, STANDING, 14.15)
    assert after is not None
    assert after.objects == {}
    assert both.pace == pytest.approx(1.0)
