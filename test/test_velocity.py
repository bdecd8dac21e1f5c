"""Velocities from positions and poses: straight motion, noise, jumps, resets."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ator_ros.geometry import Pose
from ator_ros.world.estimation import RobotVelocity, VelocityEstimate


def seen(times: list[float], vx: float, vy: float, noise: float = 0.0) -> tuple[float, float]:
    """Return the velocity after positions of straight motion at these times."""
    estimate, rng = VelocityEstimate(), np.random.default_rng(3)
    for time in times:
        x, y = vx * time + rng.normal(0.0, noise), vy * time + rng.normal(0.0, noise)
        state = estimate.state(time, float(x), float(y))
        assert (state.x, state.y) == (x, y)
    return state.vx, state.vy


def test_straight_motion_has_its_velocity() -> None:
    assert seen([0.02 * tick for tick in range(20)], 0.8, -0.3) == pytest.approx((0.8, -0.3))


def test_irregular_messages_do_not_matter() -> None:
    assert seen([0.0, 0.01, 0.07, 0.08, 0.2], 0.8, -0.3) == pytest.approx((0.8, -0.3))


def test_noise_is_averaged() -> None:
    vx, vy = seen([0.02 * tick for tick in range(30)], 0.5, 0.0, noise=0.002)
    assert (vx, vy) == pytest.approx((0.5, 0.0), abs=0.03)


def test_one_position_is_of_an_object_at_rest() -> None:
    assert seen([0.0], 0.5, 0.5) == seen([0.0, 0.01], 0.5, 0.5) == (0.0, 0.0)


@pytest.mark.parametrize("time", [0.42, -5.0, 9.0])
def test_after_a_jump_of_place_or_time_it_begins_anew(time: float) -> None:
    estimate = VelocityEstimate()
    for tick in range(21):
        estimate.state(0.02 * tick, 0.01 * tick, 0.0)
    state = estimate.state(time, 5.0, 5.0)
    assert (state.vx, state.vy) == (0.0, 0.0)


def test_a_message_that_comes_twice_changes_nothing() -> None:
    estimate = VelocityEstimate()
    for tick in range(10):
        for _ in range(2):
            state = estimate.state(0.02 * tick, 0.01 * tick, 0.0)
    assert state.vx == pytest.approx(0.5)


LIMITS = (1.2, 2.4)


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05, 0.1])
@pytest.mark.parametrize(("v", "w"), [(0.8, 0.0), (-0.4, 0.0), (0.0, 2.0), (0.8, -1.5)])
def test_a_robots_velocity_is_that_of_its_arc(period: float, v: float, w: float) -> None:
    estimate, pose = RobotVelocity(*LIMITS), Pose(1.0, 2.0, 3.0)
    for tick in range(10):
        state = estimate.state(period * tick, pose)
        assert state.pose == pose
        radius = v / w if w else 0.0
        half = w * period / 2.0
        chord = 2.0 * radius * math.sin(half) if w else v * period
        pose = pose.compose(Pose(chord * math.cos(half), chord * math.sin(half), w * period))
    assert (state.v, state.w) == pytest.approx((v, w))


def test_a_change_of_speed_shows_within_a_tick() -> None:
    estimate, x = RobotVelocity(*LIMITS), 0.0
    for tick in range(10):
        state = estimate.state(0.05 * tick, Pose(x, 0.0, 0.0))
        x += 0.05 * (0.2 if tick < 8 else 0.6)
    assert state.v == pytest.approx(0.6)


def test_a_map_that_corrects_the_robot_is_no_motion() -> None:
    estimate = RobotVelocity(*LIMITS)
    for tick in range(20):
        aside = 0.3 if tick >= 10 else 0.0
        state = estimate.state(0.05 * tick, Pose(0.04 * tick, aside, 0.0))
        assert (state.v, state.w) == pytest.approx((0.8 if tick else 0.0, 0.0))


def test_what_always_jumps_is_told_as_it_comes() -> None:
    estimate = RobotVelocity(*LIMITS)
    states = [estimate.state(0.05 * tick, Pose(0.25 * tick, 0.0, 0.0)) for tick in range(5)]
    assert states[-1].v == pytest.approx(5.0)


@pytest.mark.parametrize("time", [-3.0, 2.0])
def test_after_a_gap_or_a_reset_a_robot_is_at_rest(time: float) -> None:
    estimate = RobotVelocity(*LIMITS)
    for tick in range(10):
        estimate.state(0.05 * tick, Pose(0.04 * tick, 0.0, 0.0))
    state = estimate.state(time, Pose(5.0, 0.0, 0.0))
    assert (state.v, state.w) == (0.0, 0.0)
