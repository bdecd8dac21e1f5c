"""The observed deceleration of rolling objects: the floor may differ from the described one."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, World

_CLEAR = 0.02  # m from the robot above which it does not push an object
_SLOWEST = 0.1  # m/s below which rolling is not evaluated
_HIT = 3.0  # m/s^2; change of speed above which an object has hit something or was pushed
# s; greatest and least time between two sightings of a free roll
_LONGEST_GAP = 0.25
_LEAST_GAP = 0.02
_SHORTEST = 0.4
_ENOUGH = 0.6  # s; least time of one free roll, and of all together
_KEPT = 5  # number of free rolls, whose median is used
_MOST = 400
_FEWEST = 5  # greatest and least number of sightings in one free roll
# share by which distance and integrated speed may differ: more is noise at rest, or a curve
_STRAY = 0.15
# standard errors by which a deceleration must differ, as errors of filtered speeds correlate
_SURE = 6.0
_LEAST_CORRECTION = 1.3
_GREATEST_CORRECTION = 4.0  # multiples of the distance that an object rolls
_PUSHED = 6.0  # multiple above which something pushes it
_STEPS = 14  # steps of the described deceleration for corrections: actions compute tables for each


class Rolling:
    """Observes objects that roll freely, and corrects their described deceleration.

    A robot that brakes harder than the object that it pushes loses the object, and a wrong forecast
    of where an object stops leads to the wrong place. The deceleration is never increased: an
    object that stops early does no such harm, and may have been stopped by another robot.

    `slowest` is the speed in m/s below which sightings are too noisy.
    """

    def __init__(self, robot: Robot, *, slowest: float = _SLOWEST) -> None:
        self._described = robot
        self._slowest = max(slowest, _SLOWEST)
        # The last roll of each object may continue.
        self._rolls = {name: deque([_FreeRoll()], maxlen=_KEPT + 1) for name in robot.scene.objects}

    def observe(self, world: World) -> None:
        """Process the state `world`; repeated and extrapolated sightings are ignored."""
        for name, rolls in self._rolls.items():
            state = world.objects.get(name)
            pose = world.robot.pose
            pushed_within = self._described.reach + self._described.scene.radius(name) + _CLEAR
            if state is not None and (
                state.speed < self._slowest
                or math.hypot(state.x - pose.x, state.y - pose.y) <= pushed_within
            ):
                state = None  # it does not roll freely
            if state is None or not rolls[-1].continues(world.time, state):
                if self._fit(name, rolls[-1]) is None:
                    rolls.pop()
                rolls.append(_FreeRoll())
            if state is not None:
                rolls[-1].add(world.time, state)

    def robot(self) -> Robot:
        """Return the robot with the corrected scene, or the described robot."""
        items = self._described.scene.objects
        values = {name: value for name in items if (value := self._observed(name)) is not None}
        if not values:
            return self._described
        corrected = {
            name: dataclasses.replace(
                item, rolling_deceleration=values.get(name, item.rolling_deceleration)
            )
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
        """Return `described` for the robot with the corrected scene, or `described` itself."""
        robot = self.robot()
        return described if robot is self._described else described.with_robot(robot)

    def _fit(self, name: str, roll: _FreeRoll) -> _Fit | None:
        """Return the fit of a free roll.

        None if the deceleration is so low that the object is pushed.
        """
        fit = roll.fit()
        described = self._described.scene.objects[name].rolling_deceleration
        is_free = fit is not None and fit.deceleration - 2.0 * fit.error > described / _PUSHED
        return fit if is_free else None

    def _observed(self, name: str) -> float | None:
        """Return the observed deceleration in m/s^2.

        None if it is unknown or about as described.
        """
        described = self._described.scene.objects[name].rolling_deceleration
        fits = sorted(fit for roll in self._rolls[name] if (fit := self._fit(name, roll)))
        if sum(fit.seconds for fit in fits) < _ENOUGH:
            return None
        value, error, _ = fits[len(fits) // 2]
        if value * _LEAST_CORRECTION >= described or described - value < _SURE * error:
            return None
        return (
            max(round(value / described * _STEPS) / _STEPS, 1.0 / _GREATEST_CORRECTION) * described
        )


class _Fit(NamedTuple):
    """The linear regression of the speeds of a free roll."""

    deceleration: float  # m/s^2
    error: float  # m/s^2; standard error
    seconds: float  # duration of the roll


class _FreeRoll:
    """Consecutive sightings of one free roll."""

    def __init__(self) -> None:
        self._sightings: list[tuple[float, ObjectState]] = []  # times in s

    def continues(self, time: float, state: ObjectState) -> bool:
        """Return whether a sighting can belong to this roll."""
        if not self._sightings:
            return True
        before, last = self._sightings[-1]
        elapsed = time - before
        if len(self._sightings) == _MOST or not 0.0 <= elapsed <= _LONGEST_GAP:
            return False
        return abs(state.speed - last.speed) <= _HIT * max(elapsed, _LEAST_GAP)

    def add(self, time: float, state: ObjectState) -> None:
        """Add a sighting, unless it is too early or repeats the last velocity."""
        if self._sightings:
            before, last = self._sightings[-1]
            if time - before < _LEAST_GAP - 1e-6 or (state.vx, state.vy) == (last.vx, last.vy):
                return
        self._sightings.append((time, state))

    def fit(self) -> _Fit | None:
        """Return the regression.

        None if there are too few sightings or the distance contradicts them.
        """
        if len(self._sightings) < _FEWEST:
            return None
        times = np.array([time for time, _ in self._sightings])
        speeds = np.array([state.speed for _, state in self._sightings])
        distance = 0.5 * float((speeds[1:] + speeds[:-1]) @ np.diff(times))  # integrated speed
        first = self._sightings[0][1]
        last = self._sightings[-1][1]
        moved = math.hypot(last.x - first.x, last.y - first.y)
        seconds = float(times[-1] - times[0])
        if seconds < _SHORTEST or abs(moved - distance) > _STRAY * distance:
            return None
        (slope, _), covariance = np.polyfit(times - times[0], speeds, 1, cov=True)
        return _Fit(-float(slope), math.sqrt(covariance[0, 0]), seconds)
