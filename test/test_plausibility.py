"""Velocities that contradict the positions of what is told to have them."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from ator_ros.world.estimation import VelocityCheck
from ator_ros.world.state import ObjectState

TICK = 0.05


def checked(
    position: Callable[[float], float],
    velocity: Callable[[float], float],
    *,
    noise: float = 0.0,
    seconds: float = 2.0,
) -> tuple[list[float], list[str]]:
    """Return the velocities that are believed at 20 Hz, and what is said, of a ball that moves along x."""
    rng, check = np.random.default_rng(3), VelocityCheck("ball", noise, 3.0 * noise)
    believed, said = [], []
    for tick in range(round(seconds / TICK)):
        time, (dx, dv) = tick * TICK, rng.normal(size=2)
        sight = ObjectState(position(time) + noise * dx, 0.0, velocity(time) + 3.0 * noise * dv)
        ball, remark = check.check(time, sight)
        believed.append(ball.vx)
        said += [remark] if remark else []
    return believed, said


@pytest.mark.parametrize("noise", [0.0, 0.015])
@pytest.mark.parametrize("told", [2.0, 5.0, -40.0])
def test_a_ball_that_lies_is_not_believed_to_roll(told: float, noise: float) -> None:
    believed, said = checked(lambda _: 1.0, lambda t: told if t >= 0.5 else 0.0, noise=noise)
    assert max(map(abs, believed[15:])) < 0.6
    assert len(said) == 1
    assert "ball.twist.twist.linear: expected about" in said[0]


@pytest.mark.parametrize("told", [0.0, -1.0])
def test_a_ball_that_rolls_is_believed_to_do_as_it_is_seen(told: float) -> None:
    believed, _ = checked(lambda t: 2.0 * t, lambda _: told)
    assert believed[10:] == pytest.approx([2.0] * 30)


def test_velocities_that_flicker_are_believed_at_most_for_a_moment() -> None:
    believed, _ = checked(lambda _: 1.0, lambda t: 5.0 * (round(t / TICK) % 2))
    assert sum(abs(v) > 0.6 for v in believed) <= 8


@pytest.mark.parametrize("noise", [0.0, 0.015])
def test_a_kick_is_believed(noise: float) -> None:
    def speed(time: float) -> float:
        return max(0.0, 3.0 - 0.7 * (time - 0.5)) if time >= 0.5 else 0.0

    def place(time: float) -> float:
        rolled = max(0.0, time - 0.5)
        return 3.0 * rolled - 0.35 * rolled**2

    believed, said = checked(place, speed, noise=noise)
    assert said == []
    assert believed == pytest.approx([speed(tick * TICK) for tick in range(40)], abs=0.25 if noise else 1e-9)


def test_a_ball_that_is_placed_elsewhere_does_not_roll() -> None:
    believed, _ = checked(lambda t: 3.0 if t >= 1.0 else 0.0, lambda _: 0.0)
    assert believed == [0.0] * 40


def test_a_ball_that_stops_at_a_wall_is_believed() -> None:
    believed, said = checked(lambda t: min(t, 1.0), lambda t: 1.0 if t < 1.0 else 0.0)
    assert believed == pytest.approx([1.0] * 20 + [0.0] * 20)
    assert said == []


def test_noise_is_no_contradiction() -> None:
    for told in (0.0, 1.0):
        assert checked(lambda t, v=told: v * t, lambda _, v=told: v, noise=0.015, seconds=60.0)[1] == []


def test_a_velocity_that_is_wrong_again_after_a_pause_is_named_again() -> None:
    def told(time: float) -> float:
        return 5.0 if time % 3.0 < 1.0 else 0.0

    assert len(checked(lambda _: 1.0, told, seconds=8.9)[1]) == 3


def test_a_ball_that_was_long_gone_or_repeats_its_stamp_begins_anew() -> None:
    check = VelocityCheck("ball", 0.0, 0.0)
    for tick in range(10):
        check.check(tick * TICK, ObjectState(0.0, 0.0))
    kicked = ObjectState(5.0, 0.0, 3.0)
    assert check.check(5.0, kicked) == (kicked, None)
    assert check.check(5.0, kicked) == (kicked, None)
    assert math.isfinite(check.check(5.0 + 1e-9, kicked)[0].vx)


def test_sights_whose_stamps_stand_take_no_more_and_more_memory() -> None:
    check = VelocityCheck("ball", 0.0, 0.0)
    tracemalloc.start()
    for _ in range(10_000):  # a simulation that is paused for eight minutes
        check.check(float("1.5"), ObjectState(0.5, 0.0))
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert used < 100_000
