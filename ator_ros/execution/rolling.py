"""How objects slow down, as observed: a floor may not be the described one."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, World

_CLEAR = 0.02
"""Distance in m from the robot beyond which it does not push an object."""
_SLOWEST = 0.1
"""Speed in m/s below which rolling is not judged."""
_HIT = 3.0
"""Change of speed in m/s^2 above which an object has hit something or was pushed."""
_LONGEST_GAP, _LEAST_GAP = 0.25, 0.02
"""Greatest and least time in s between two sightings of a free roll."""
_SHORTEST, _ENOUGH = 0.4, 0.6
"""Least time in s of one free roll, and of all together, that counts."""
_KEPT = 5
"""Free rolls that are kept; their median counts."""
_MOST = 400
"""Greatest number of sightings in one free roll."""
_STRAY = 0.15
"""Share by which distance and integrated speed may differ: more is noise of a resting object, or a curve."""
_SURE = 3.0
"""Standard errors by which the observed deceleration must differ from the described one."""
_FARTHER, _FARTHEST, _PUSHED = 1.3, 4.0, 6.0
"""How many times as far as described: least that is corrected, greatest correction, and only if pushed."""
_FEWEST = 5
"""Least number of sightings of a free roll that counts."""
_ROUNDING = 1e-6  # s
_STEPS = 14
"""Steps of the described deceleration to which corrections are rounded: actions compute tables for each."""


class Rolling:
    """Observes objects that roll freely, and corrects their described deceleration.

    A robot that brakes harder than the object that it pushes loses it; one that expects an object to stop
    early drives to the wrong place. Objects that stop earlier than described do no such harm, and look like
    objects that another robot brakes: they are never corrected.

    Parameters
    ----------
    slowest : float
        Speed in m/s below which sightings are too noisy to judge by.
    """

    def __init__(self, robot: Robot, *, slowest: float = _SLOWEST) -> None:
        self._described = self._robot = robot
        self._libraries: dict[str, TopLibrary] = {}  # corrected, by action set
        self._slowest = max(slowest, _SLOWEST)
        self._now = {name: _FreeRoll() for name in robot.scene.objects}
        self._past = {name: deque[Fit](maxlen=_KEPT) for name in robot.scene.objects}
        self._velocities: dict[str, tuple[float, float]] = {}

    def observe(self, world: World) -> None:
        """Process the state `world`; repeated and extrapolated sightings are ignored."""
        for name, roll in self._now.items():
            state = world.objects.get(name)
            if state is not None and self._velocities.get(name) == (state.vx, state.vy):
                continue  # the sighting before, perhaps extrapolated: objects that roll become slower
            if state is not None:
                self._velocities[name] = state.vx, state.vy
            if state is None or not self._is_free(world, name, state):
                self._end(name)
            elif roll.continues(world.time, state):
                roll.add(world.time, state)
            else:
                self._end(name)
                self._now[name].add(world.time, state)

    def robot(self) -> Robot:
        """Return the robot with the corrected scene; the described one if nothing is corrected."""
        items = self._described.scene.objects
        corrected = dict(items)
        for name in items:
            value = self._observed(name)
            if value is not None:
                corrected[name] = dataclasses.replace(items[name], rolling_deceleration=value)
        if corrected == dict(items):
            self._robot = self._described
        elif corrected != dict(self._robot.scene.objects):
            scene = dataclasses.replace(self._described.scene, objects=corrected)
            self._robot = dataclasses.replace(self._described, scene=scene)
        return self._robot

    def diagnostics(self) -> dict[str, str]:
        """Return the diagnostics of corrected objects."""
        items = self._described.scene.objects
        return {
            f"{name} rolls": f"slows down by {item.rolling_deceleration:.2f} m/s^2, "
            f"described as {items[name].rolling_deceleration:g}"
            for name, item in self.robot().scene.objects.items()
            if item != items[name]
        }

    def library(self, described: TopLibrary) -> TopLibrary:
        """Return `described` for the robot with the corrected scene; itself where nothing is corrected."""
        robot = self.robot()
        if robot is self._described:
            return described
        library = self._libraries.get(described.action_set)
        if library is None or library.robot is not robot:
            library = self._libraries[described.action_set] = described.with_robot(robot)
        return library

    def _is_free(self, world: World, name: str, state: ObjectState) -> bool:
        """Return whether an object rolls, out of the reach of the robot."""
        robot, pose = self._described, world.robot.pose
        away = math.hypot(state.x - pose.x, state.y - pose.y)
        near = robot.reach + robot.scene.radius(name) + _CLEAR
        return state.speed >= self._slowest and away > near

    def _end(self, name: str) -> None:
        """End the free roll of an object, and keep its fit if it is plausible."""
        fit = self._now[name].fit()
        self._now[name] = _FreeRoll()
        if fit is not None and self._is_likely(name, fit):
            self._past[name].append(fit)

    def _is_likely(self, name: str, fit: Fit) -> bool:
        """Return whether the floor alone can have caused this deceleration."""
        described = self._described.scene.objects[name].rolling_deceleration
        return fit.deceleration - 2.0 * fit.error > described / _PUSHED

    def _observed(self, name: str) -> float | None:
        """Return the observed deceleration in m/s^2; None if it is unknown, or about the described one."""
        now, described = self._now[name].fit(), self._described.scene.objects[name].rolling_deceleration
        fits = [*self._past[name], *([now] if now is not None and self._is_likely(name, now) else [])]
        if sum(fit.seconds for fit in fits) < _ENOUGH:
            return None
        middle = sorted(fits, key=lambda fit: fit.deceleration)[len(fits) // 2]
        value = middle.deceleration
        if value * _FARTHER >= described or described - value < _SURE * middle.error:
            return None
        return max(round(value / described * _STEPS) / _STEPS, 1.0 / _FARTHEST) * described


class Fit(NamedTuple):
    """A line through the speeds of a free roll: its length in s, deceleration and standard error in m/s^2."""

    seconds: float
    deceleration: float
    error: float


class _FreeRoll:
    """Consecutive sightings of one free roll."""

    def __init__(self) -> None:
        self._sightings: list[tuple[float, ObjectState]] = []  # times in s

    def continues(self, time: float, state: ObjectState) -> bool:
        """Return whether a sighting can follow those before."""
        if not self._sightings:
            return True
        before, last = self._sightings[-1]
        elapsed = time - before
        if len(self._sightings) == _MOST or not 0.0 <= elapsed <= _LONGEST_GAP:
            return False
        return abs(state.speed - last.speed) <= _HIT * max(elapsed, _LEAST_GAP)

    def add(self, time: float, state: ObjectState) -> None:
        """Add a sighting, unless another one was just before."""
        if not self._sightings or time - self._sightings[-1][0] >= _LEAST_GAP - _ROUNDING:
            self._sightings.append((time, state))

    def fit(self) -> Fit | None:
        """Return the line through all speeds; None if they are too few, or do not fit the distance."""
        if len(self._sightings) < _FEWEST:
            return None
        times = np.array([time for time, _ in self._sightings])
        speeds = np.array([state.speed for _, state in self._sightings])
        seconds = float(times[-1] - times[0])
        distance = 0.5 * float((speeds[1:] + speeds[:-1]) @ np.diff(times))
        first, last = self._sightings[0][1], self._sightings[-1][1]
        gone = math.hypot(last.x - first.x, last.y - first.y)
        if seconds < _SHORTEST or abs(gone - distance) > _STRAY * distance:
            return None
        at = times - times.mean()
        squares = float(at @ at)
        slope = float(at @ speeds) / squares
        residuals = speeds - speeds.mean() - slope * at
        error = math.sqrt(float(residuals @ residuals) / (len(times) - 2) / squares)
        return Fit(seconds, -slope, error * _autocorrelation_factor(residuals))


def _autocorrelation_factor(residuals: FloatArray) -> float:
    """Return the factor of the standard error for autocorrelated residuals, as filtered sightings leave."""
    total = float(residuals @ residuals)
    if total == 0.0:
        return 1.0
    correlation = float(residuals[1:] @ residuals[:-1]) / total
    correlation += 3.0 / len(residuals)  # its bias
    correlation = min(max(correlation, 0.0), 0.95)
    return math.sqrt((1.0 + correlation) / (1.0 - correlation))
