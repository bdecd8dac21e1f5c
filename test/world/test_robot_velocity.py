"""State estimation of objects and robots from noisy, incomplete or contradictory messages."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from ator_ros.geometry import Pose
from ator_ros.world.robot_velocity import RobotVelocity
from ator_ros.world.sightings import ObjectTracker, VelocityCheck
from ator_ros.world.state import ObjectState

TICK = 0.05
NOISE, VELOCITY_NOISE = 0.015, 0.05


def measurements(balls: list[ObjectState]) -> list[ObjectState]:
    rng = np.random.default_rng(1)
    measured = []
    for ball in balls:
        x, y = rng.normal(scale=NOISE, size=2)
        vx, vy = rng.normal(scale=VELOCITY_NOISE, size=2)
        measured.append(ObjectState(ball.x + x, ball.y + y, ball.vx + vx, ball.vy + vy))
    return measured


def tracked(measured: list[ObjectState]) -> list[ObjectState]:
    tracker = ObjectTracker(NOISE, VELOCITY_NOISE)
    return [tracker.update(tick * TICK, ball) for tick, ball in enumerate(measured)]


def errors(estimated: list[ObjectState], balls: list[ObjectState]) -> list[float]:
    return [np.hypot(b.x - t.x, b.y - t.y) for b, t in zip(estimated, balls, strict=True)]


def test_the_estimate_of_a_resting_ball_is_better_than_measurements() -> None:
    balls = [ObjectState(1.0, -1.0)] * 200
    measured = measurements(balls)
    assert np.mean(errors(tracked(measured), balls)[20:]) < 0.4 * np.mean(errors(measured, balls))


def test_a_kicked_or_placed_ball_is_tracked_immediately() -> None:
    balls = [ObjectState(0.0, 0.0)] * 50 + [ObjectState(1.0, 1.0)] * 10
    estimated = tracked(measurements(balls))
    assert errors(estimated, balls)[50] < 5 * NOISE
    kicked = [ObjectState(0.0, 0.0)] * 50 + [
        ObjectState(t * TICK, 0.0, 1.0, 0.0) for t in range(10)
    ]
    assert tracked(measurements(kicked))[50].vx == pytest.approx(1.0, abs=5 * VELOCITY_NOISE)


def checked(
    position: Callable[[float], float],
    velocity: Callable[[float], float],
    *,
    noise: float = 0.0,
) -> tuple[list[float], list[str]]:
    """Return the estimated velocities at 20 Hz, and the remarks, of a ball that moves along x."""
    rng, check = np.random.default_rng(3), VelocityCheck("ball", noise, 3.0 * noise)
    estimated, remarks = [], []
    for tick in range(round(2.0 / TICK)):
        time, (dx, dv) = tick * TICK, rng.normal(size=2)
        measurement = ObjectState(
            position(time) + noise * dx, 0.0, velocity(time) + 3.0 * noise * dv
        )
        ball, remark = check.check(time, measurement)
        estimated.append(ball.vx)
        remarks += [remark] if remark else []
    return estimated, remarks


@pytest.mark.parametrize("noise", [0.0, 0.015])
@pytest.mark.parametrize("reported", [2.0, 5.0, -40.0])
def test_a_false_velocity_of_a_resting_ball_is_ignored(reported: float, noise: float) -> None:
    estimated, remarks = checked(
        lambda _: 1.0, lambda t: reported if t >= 0.5 else 0.0, noise=noise
    )
    assert max(map(abs, estimated[15:])) < 0.6
    assert len(remarks) == 1
    assert "ball.twist.twist.linear: expected about" in remarks[0]


@pytest.mark.parametrize("reported", [0.0, -1.0])
def test_a_false_velocity_of_a_rolling_ball_is_replaced(reported: float) -> None:
    estimated, _ = checked(lambda t: 2.0 * t, lambda _: reported)
    assert estimated[10:] == pytest.approx([2.0] * 30)


LIMITS = (1.2, 2.4)


@pytest.mark.parametrize("period", [0.02, 0.1])
@pytest.mark.parametrize(("v", "w"), [(0.8, 0.0), (-0.4, 0.0), (0.0, 2.0), (0.8, -1.5)])
def test_the_velocity_of_a_robot_is_that_of_its_arc(period: float, v: float, w: float) -> None:
    estimate, pose = RobotVelocity(*LIMITS), Pose(1.0, 2.0, 3.0)
    for tick in range(10):
        state = estimate.state(period * tick, pose)
        assert state.pose == pose
        radius = v / w if w else 0.0
        half = w * period / 2.0
        chord = 2.0 * radius * math.sin(half) if w else v * period
        pose = pose.compose(Pose(chord * math.cos(half), chord * math.sin(half), w * period))
    assert (state.vx, state.w) == pytest.approx((v, w))


@pytest.mark.parametrize("time", [-3.0, 2.0])
def test_after_a_gap_or_a_reset_a_robot_is_at_rest(time: float) -> None:
    estimate = RobotVelocity(*LIMITS)
    for tick in range(10):
        estimate.state(0.05 * tick, Pose(0.04 * tick, 0.0, 0.0))
    state = estimate.state(time, Pose(5.0, 0.0, 0.0))
    assert (state.vx, state.w) == (0.0, 0.0)


@pytest.mark.parametrize("distance", [0.05, 0.4])
def test_jumps_to_and_fro_do_not_become_a_velocity(distance: float) -> None:
    estimate = RobotVelocity(0.5, 2.0)
    for tick in range(80):
        x = 0.1 * 0.02 * tick + (distance if tick % 4 else 0.0)
        state = estimate.state(0.02 * tick, Pose(x, 0.0, 0.0))
        assert abs(state.vx) <= 0.75


@pytest.mark.parametrize(("v", "w"), [(1.7, 0.0), (-1.7, 0.0), (0.0, 3.5), (0.0, -3.5)])
def test_motion_of_up_to_half_above_the_limits_is_no_jump(v: float, w: float) -> None:
    for factor, is_motion in ((1.0, True), (1.1, False)):
        estimate = RobotVelocity(*LIMITS)
        estimate.state(0.0, Pose(0.0, 0.0, 0.0))
        state = estimate.state(0.1, Pose(0.1 * v * factor, 0.0, 0.1 * w * factor))
        assert ((state.vx, state.w) != (0.0, 0.0)) is is_motion


def test_a_robot_that_jumps_sideways_keeps_its_velocity() -> None:
    estimate = RobotVelocity(*LIMITS)
    for tick in range(10):
        estimate.state(0.05 * tick, Pose(0.04 * tick, 0.0, 0.0))
    state = estimate.state(0.5, Pose(0.4, 0.2, 0.0))
    assert (state.vx, state.w) == pytest.approx((0.8, 0.0))


def test_two_jumps_that_continue_each_other_are_motion() -> None:
    estimate = RobotVelocity(0.5, 1.0)
    speeds = [estimate.state(0.05 * tick, Pose(0.1 * tick, 0.0, 0.0)).vx for tick in range(6)]
    assert speeds[:2] == [0.0, 0.0]
    assert speeds[2:] == pytest.approx([2.0] * 4)


@pytest.mark.parametrize(("gap", "v"), [(0.29, 0.8), (0.31, 0.0)])
def test_three_tenths_of_a_second_are_a_gap(gap: float, v: float) -> None:
    estimate = RobotVelocity(*LIMITS)
    for tick in range(10):
        estimate.state(0.05 * tick, Pose(0.04 * tick, 0.0, 0.0))
    state = estimate.state(0.45 + gap, Pose(0.36 + 0.8 * gap, 0.0, 0.0))
    assert state.vx == pytest.approx(v)


def test_the_velocity_is_the_mean_of_a_control_tick() -> None:
    estimate = RobotVelocity(*LIMITS)
    for tick in range(11):  # at 100 Hz, with a change of speed
        state = estimate.state(0.01 * tick, Pose(0.005 * tick, 0.0, 0.0))
    assert state.vx == pytest.approx(0.5)
    for tick in range(1, 3):
        state = estimate.state(0.1 + 0.01 * tick, Pose(0.05 + 0.01 * tick, 0.0, 0.0))
    assert state.vx == pytest.approx(0.75)
