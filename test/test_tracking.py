"""The ball's state from noisy sights of it."""

from __future__ import annotations

import numpy as np
import pytest

from ator_ros.domains.soccer.ball import BALL, ball_of
from ator_ros.geometry import Pose
from ator_ros.world.estimation import ObjectTracker
from ator_ros.world.state import ObjectState, RobotState, World

TICK = 0.05
NOISE, VELOCITY_NOISE = 0.015, 0.05


def sights(balls: list[ObjectState], seed: int = 1) -> list[ObjectState]:
    rng = np.random.default_rng(seed)
    seen = []
    for ball in balls:
        x, y = rng.normal(scale=NOISE, size=2)
        vx, vy = rng.normal(scale=VELOCITY_NOISE, size=2)
        seen.append(ObjectState(ball.x + x, ball.y + y, ball.vx + vx, ball.vy + vy))
    return seen


def tracked(seen: list[ObjectState]) -> list[ObjectState]:
    tracker = ObjectTracker(NOISE, VELOCITY_NOISE)
    return [tracker.update(tick * TICK, ball) for tick, ball in enumerate(seen)]


def errors(believed: list[ObjectState], balls: list[ObjectState]) -> list[float]:
    return [np.hypot(b.x - t.x, b.y - t.y) for b, t in zip(believed, balls, strict=True)]


def test_a_resting_ball_is_known_better_than_it_is_seen() -> None:
    balls = [ObjectState(1.0, -1.0)] * 200
    seen = sights(balls)
    assert np.mean(errors(tracked(seen), balls)[20:]) < 0.4 * np.mean(errors(seen, balls))


def test_a_rolling_ball_is_followed() -> None:
    balls = [ObjectState(t * TICK - 0.3 * (t * TICK) ** 2, 0.0, 1.0 - 0.6 * t * TICK, 0.0) for t in range(30)]
    seen = sights(balls)
    assert np.mean(errors(tracked(seen), balls)) < np.mean(errors(seen, balls))


def test_a_ball_that_is_kicked_or_placed_is_believed_at_once() -> None:
    balls = [ObjectState(0.0, 0.0)] * 50 + [ObjectState(1.0, 1.0)] * 10
    believed = tracked(sights(balls))
    assert errors(believed, balls)[50] < 5 * NOISE
    kicked = [ObjectState(0.0, 0.0)] * 50 + [ObjectState(t * TICK, 0.0, 1.0, 0.0) for t in range(10)]
    assert tracked(sights(kicked))[50].vx == pytest.approx(1.0, abs=5 * VELOCITY_NOISE)


def test_without_noise_sights_are_believed_as_they_are() -> None:
    tracker = ObjectTracker(0.0, 0.0)
    balls = sights([ObjectState(1.0, 2.0, 0.3, 0.4)] * 10)
    assert [tracker.update(tick * TICK, ball) for tick, ball in enumerate(balls)] == balls


def test_a_repeated_stamp_is_no_new_sight_unless_the_ball_is_elsewhere() -> None:
    tracker = ObjectTracker(NOISE, VELOCITY_NOISE)
    for tick, ball in enumerate(sights([ObjectState(1.0, 0.0)] * 20)):
        believed = tracker.update(tick * TICK, ball)
    assert tracker.update(19 * TICK, ObjectState(1.02, 0.01)) == believed
    assert tracker.update(19 * TICK, ObjectState(2.0, 0.0)) == ObjectState(2.0, 0.0)
    exact = ObjectTracker(NOISE, 0.0)
    assert exact.update(1.0, ObjectState(1.0, 0.0)) == exact.update(1.0, ObjectState(1.01, 0.0))


def test_time_that_goes_back_or_a_ball_that_was_gone_starts_anew() -> None:
    tracker = ObjectTracker(NOISE, VELOCITY_NOISE)
    robot = RobotState(Pose(0.0, 0.0, 0.0))
    for tick in range(50):
        tracker.observe(World(tick * TICK, robot, {BALL: ObjectState(1.0, 0.0)}), BALL)
    assert ball_of(tracker.observe(World(0.0, robot, {BALL: ObjectState(1.03, 0.0)}), BALL)) == ObjectState(
        1.03, 0.0
    )
    assert ball_of(tracker.observe(World(0.05, robot), BALL)) is None
    assert ball_of(tracker.observe(World(0.1, robot, {BALL: ObjectState(0.98, 0.0)}), BALL)) == ObjectState(
        0.98, 0.0
    )
