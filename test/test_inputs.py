"""The executor node's inputs, without ROS: odometry and ball joined in time."""

from __future__ import annotations

import contextlib

import pytest

from ator_ros.geometry import Pose
from ator_ros.nodes.inputs import Inputs, OtherClockError, TimeWentBackError
from ator_ros.tracking import BallTracker
from ator_ros.world import BallState, RobotState


def inputs() -> Inputs:
    return Inputs(0.3, BallTracker(0.0, 0.0))


def test_the_ball_is_that_of_the_odometrys_time_whatever_comes_first() -> None:
    both = inputs()
    both.ball(1.0, BallState(0.0, 0.0, 1.0, -2.0))
    both.ball(1.1, BallState(5.0, 5.0))
    joined = both.robot(1.05, RobotState(Pose(0.0, 0.0, 0.0)))
    assert joined is not None
    assert joined.ball is not None
    assert (joined.ball.x, joined.ball.y) == pytest.approx((0.05, -0.1))


def test_an_old_ball_is_unknown() -> None:
    both = inputs()
    both.ball(1.0, BallState(0.0, 0.0))
    joined = both.robot(1.31, RobotState(Pose(0.0, 0.0, 0.0)))
    assert joined is not None
    assert joined.ball is None


def test_a_ball_is_overdue_when_nothing_has_come_of_it_for_half_its_timeout() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    both.robot(1.0, robot)
    assert both.ball_overdue  # none has ever come
    both.ball(0.9, BallState(0.0, 0.0))  # late, as from a camera, and heard
    for time in (1.05, 1.1):
        both.robot(time, robot)
        assert not both.ball_overdue
    both.robot(1.15, robot)
    assert both.ball_overdue
    both.ball(1.15, BallState(0.0, 0.0))
    assert not both.ball_overdue


@pytest.mark.parametrize("stamp", [1.3, 2.9, 1e9])
def test_a_ball_from_the_future_does_not_pass_for_one_that_comes(stamp: float) -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    both.ball(stamp, BallState(0.0, 0.0))  # before there is odometry to compare with
    both.robot(1.0, robot)
    with contextlib.suppress(OtherClockError):
        both.ball(stamp, BallState(0.0, 0.0))
    both.robot(1.25, robot)
    assert both.ball_overdue


def test_a_ball_of_another_clock_is_refused() -> None:
    both = inputs()
    both.robot(1.0, RobotState(Pose(0.0, 0.0, 0.0)))
    with pytest.raises(OtherClockError, match=r"near odometry's 1\.00 s, got 1700000000\.00 s"):
        both.ball(1.7e9, BallState(0.0, 0.0))


def test_time_that_stands_is_no_news_and_time_that_goes_back_an_error() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    assert both.robot(1.0, robot) is not None
    assert both.robot(1.0, robot) is None
    with pytest.raises(TimeWentBackError, match=r"after 1\.00 s, got 0\.50 s"):
        both.robot(0.5, robot)
    assert both.robot(0.55, robot) is not None
