"""A Kalman filter for the state of an object that rolls and is pushed."""

from __future__ import annotations

import math

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.world.state import ObjectState, World

_PUSH = 1.0
"""Standard deviation in m/s^2 of the acceleration of a moving object; a tenth of it applies at rest."""
_SURPRISE = 5.0
"""A sighting this many standard deviations off restarts the filter: the object was pushed or moved."""
_FORGET = 1.0
"""Time in s without a sighting after which the filter restarts."""


class ObjectTracker:
    """Filters the sightings of one object; restarts where they jump.

    Both coordinates share one covariance, because noise and pushes are the same for both.

    Parameters
    ----------
    noise : float
        Standard deviation of the coordinates of a sighting in m; 0: sightings are not filtered.
    velocity_noise : float
        Standard deviation of the components of its velocity in m/s; above 0 if `noise` is.
    """

    def __init__(self, noise: float, velocity_noise: float) -> None:
        self.noise, self.velocity_noise = noise, velocity_noise
        self._seen = np.diag([noise**2, velocity_noise**2])
        self._exact = noise == 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the object."""
        self._time = -math.inf
        self._state = np.zeros((2, 2))  # rows: position, velocity; columns: x, y
        self._covariance = self._seen

    def update(self, time: float, there: ObjectState) -> ObjectState:
        """Process a sighting at `time` (s); return the filtered state.

        A sighting with the time of the last one is ignored, unless it jumps.
        """
        if self._exact:
            return there
        sight = np.array([[there.x, there.y], [there.vx, there.vy]])
        elapsed = time - self._time
        if not 0.0 <= elapsed <= _FORGET or self._surprised(sight, elapsed):
            self._state, self._covariance = sight, self._seen
        elif elapsed > 0.0:
            self._believe(sight, elapsed)
        self._time = time
        (x, y), (vx, vy) = self._state.tolist()
        return ObjectState(x, y, vx, vy)

    def observe(self, world: World, name: str) -> World:
        """Return `world` with the filtered state of the object `name`."""
        there = world.objects.get(name)
        if there is None:
            self.reset()
            return world
        return world.with_object(name, self.update(world.time, there))

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
        """Return the covariance predicted after `elapsed` s with random pushes."""
        moves = math.hypot(*self._state[1]) > 3.0 * math.sqrt(self._seen[1, 1])
        motion = self._motion(elapsed)
        push = np.array([elapsed**2 / 2.0, elapsed]) * (_PUSH if moves else 0.1 * _PUSH)
        return motion @ self._covariance @ motion.T + np.outer(push, push)
