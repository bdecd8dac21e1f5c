"""Velocities from positions: straight motion, noise, jumps, resets."""

from __future__ import annotations

import numpy as np
import pytest

from ator_ros.world.velocity import VelocityEstimate


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
