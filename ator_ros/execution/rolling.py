"""How objects slow down, as observed: a floor may not be the described one."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, World

_CLEAR = 0.02  # m from the robot beyond which it does not push an object
_SLOWEST = 0.1  # m/s below which rolling is not judged
_HIT = 3.0  # change of speed in m/s^2 above which an object has hit something or was pushed
_LONGEST_GAP, _LEAST_GAP = 0.25, 0.02  # greatest and least time in s between two sightings of a free roll
_SHORTEST, _ENOUGH = 0.4, 0.6  # s: least time of one free roll, and of all together, that counts
_KEPT = 5  # free rolls that are kept; their median counts
_MOST, _FEWEST = 400, 5  # greatest and least number of sightings in one free roll that counts
_STRAY = 0.15  # share by which distance and integrated speed may differ: more is noise at rest, or a curve
_SURE = 6.0  # standard errors by which a deceleration must differ; errors of filtered speeds are alike
_FARTHER, _FARTHEST, _PUSHED = 1.3, 4.0, 6.0
"""How many times as far as described: least that is corrected, greatest correction, and only if pushed."""
_STEPS = 14  # steps of the described deceleration for corrections: actions compute tables for each


class Rolling:
    """Observes objects that roll freely, and corrects their described deceleration.

    A robot that brakes harder than the object that it pushes loses it; one that expects an object to stop
    early drives to the wrong place. Objects that stop earlier than described do no such harm, and look like
    objects that another robot brakes: they are never corrected.

    `slowest` is the speed in m/s below which sightings are too noisy to judge by.
    """

    def __init__(self, robot: Robot, *, slowest: float = _SLOWEST) -> None:
        self._described, self._slowest = robot, max(slowest, _SLOWEST)
        # The last roll of each object may go on.
        self._rolls = {name: deque([_FreeRoll()], maxlen=_KEPT + 1) for name in robot.scene.objects}

    def observe(self, world: World) -> None:
        """Process the state `world`; repeated and extrapolated sightings are ignored."""
        for name, rolls in self._rolls.items():
            state, pose = world.objects.get(name), world.robot.pose
            near = self._described.reach + self._described.scene.radius(name) + _CLEAR
            if state is not None and (
                state.speed < self._slowest or math.hypot(state.x - pose.x, state.y - pose.y) <= near
            ):
                state = None
            if state is None or not rolls[-1].continues(world.time, state):
                if self._fit(name, rolls[-1]) is None:
                    rolls.pop()
                rolls.append(_FreeRoll())
            if state is not None:
                rolls[-1].add(world.time, state)

    def robot(self) -> Robot:
        """Return the robot with the corrected scene; the described one if nothing is corrected."""
        items = self._described.scene.objects
        values = {name: value for name in items if (value := self._observed(name)) is not None}
        if not values:
            return self._described
        corrected = {
            name: dataclasses.replace(item, rolling_deceleration=values.get(name, item.rolling_deceleration))
            for name, item in items.items()
        }
        scene = dataclasses.replace(self._described.scene, objects=corrected)
        return dataclasses.replace(self._described, scene=scene)

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
        return described if robot is self._described else described.with_robot(robot)

    def _fit(self, name: str, roll: _FreeRoll) -> _Fit | None:
        """Return the fit of a free roll; None where the floor alone cannot have caused this deceleration."""
        fit, described = roll.fit(), self._described.scene.objects[name].rolling_deceleration
        slow = fit is not None and fit.deceleration - 2.0 * fit.error > described / _PUSHED
        return fit if slow else None

    def _observed(self, name: str) -> float | None:
        """Return the observed deceleration in m/s^2; None if it is unknown, or about the described one."""
        described = self._described.scene.objects[name].rolling_deceleration
        fits = sorted(fit for roll in self._rolls[name] if (fit := self._fit(name, roll)))
        if sum(fit.seconds for fit in fits) < _ENOUGH:
            return None
        value, error, _ = fits[len(fits) // 2]
        if value * _FARTHER >= described or described - value < _SURE * error:
            return None
        return max(round(value / described * _STEPS) / _STEPS, 1.0 / _FARTHEST) * described


class _Fit(NamedTuple):
    """A line through the speeds of a free roll: deceleration and its error in m/s^2, length in s."""

    deceleration: float
    error: float
    seconds: float


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
        """Add a sighting, unless one was just before, or has the same velocity: objects become slower."""
        if self._sightings:
            before, last = self._sightings[-1]
            if time - before < _LEAST_GAP - 1e-6 or (state.vx, state.vy) == (last.vx, last.vy):
                return
        self._sightings.append((time, state))

    def fit(self) -> _Fit | None:
        """Return the line through all speeds; None if they are too few, or do not fit the distance."""
        if len(self._sightings) < _FEWEST:
            return None
        times = np.array([time for time, _ in self._sightings])
        speeds = np.array([state.speed for _, state in self._sightings])
        distance = 0.5 * float((speeds[1:] + speeds[:-1]) @ np.diff(times))
        first, last = self._sightings[0][1], self._sightings[-1][1]
        gone = math.hypot(last.x - first.x, last.y - first.y)
        seconds = float(times[-1] - times[0])
        if seconds < _SHORTEST or abs(gone - distance) > _STRAY * distance:
            return None
        (slope, _), covariance = np.polyfit(times - times[0], speeds, 1, cov=True)
        return _Fit(-float(slope), math.sqrt(covariance[0, 0]), seconds)
