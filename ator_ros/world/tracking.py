"""The ball's state from noisy sights of it: a Kalman filter for a ball that rolls and is pushed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.world.state import BallState, World

_PUSH = 1.0
"""Standard deviation in m/s^2 of the acceleration of a ball that moves; a resting one has a tenth of it."""
_SURPRISE = 5.0
"""A sight this many standard deviations off is a new start: the ball was kicked, or placed elsewhere."""
_FORGET = 1.0
"""Time in s without a sight after which the past counts no more."""


class BallTracker:
    """Believes in a steady ball more than in one sight of it; a ball that is suddenly elsewhere is believed.

    Both coordinates have the same covariance, since they are seen and pushed alike.

    Parameters
    ----------
    noise : float
        Standard deviation of a sight's coordinates in m; 0 takes every sight as it is.
    velocity_noise : float
        Standard deviation of a sight's velocity components in m/s; above 0 where `noise` is.
    """

    def __init__(self, noise: float, velocity_noise: float) -> None:
        self.noise, self.velocity_noise = noise, velocity_noise
        self._seen = np.diag([noise**2, velocity_noise**2])
        self._exact = noise == 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the ball."""
        self._time = -math.inf
        self._state = np.zeros((2, 2))  # rows: position, velocity; columns: x, y
        self._covariance = self._seen

    def update(self, time: float, ball: BallState) -> BallState:
        """Take a sight of the ball at `time` s; give the ball as it is believed to be.

        A repeated time is no new sight, unless the ball is suddenly elsewhere.
        """
        if self._exact:
            return ball
        sight = np.array([[ball.x, ball.y], [ball.vx, ball.vy]])
        elapsed = time - self._time
        if not 0.0 <= elapsed <= _FORGET or self._surprised(sight, elapsed):
            self._state, self._covariance = sight, self._seen
        elif elapsed > 0.0:
            self._believe(sight, elapsed)
        self._time = time
        (x, y), (vx, vy) = self._state.tolist()
        return BallState(x, y, vx, vy)

    def observe(self, world: World) -> World:
        """Return `world` with the ball as it is believed to be."""
        if world.ball is None:
            self.reset()
            return world
        return dataclasses.replace(world, ball=self.update(world.time, world.ball))

    def _surprised(self, sight: FloatArray, elapsed: float) -> bool:
        expected = self._motion(elapsed) @ self._state
        spread = np.sqrt(np.diag(self._predicted(elapsed) + self._seen))
        return bool(np.any(np.abs(sight - expected) > _SURPRISE * spread[:, None]))

    def _believe(self, sight: FloatArray, elapsed: float) -> None:
        expected, covariance = self._motion(elapsed) @ self._state, self._predicted(elapsed)
        gain = covariance @ np.linalg.inv(covariance + self._seen)
        self._state = expected + gain @ (sight - expected)
        self._covariance = (np.eye(2) - gain) @ covariance

    @staticmethod
    def _motion(elapsed: float) -> FloatArray:
        return np.array([[1.0, elapsed], [0.0, 1.0]])

    def _predicted(self, elapsed: float) -> FloatArray:
        """Return the covariance after `elapsed` s, in which the ball may have been pushed."""
        moves = math.hypot(*self._state[1]) > 3.0 * math.sqrt(self._seen[1, 1])
        motion = self._motion(elapsed)
        push = np.array([elapsed**2 / 2.0, elapsed]) * (_PUSH if moves else 0.1 * _PUSH)
        return motion @ self._covariance @ motion.T + np.outer(push, push)
