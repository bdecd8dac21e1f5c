"""How far objects roll, as they are seen to: a carpet is not what a description says of the floor."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.printable import short
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, World

_CLEAR = 0.02
"""Distance in m from the robot beyond which it does not push an object."""
_SLOWEST = 0.1
"""Speed in m/s below which rolling is not judged."""
_HIT = 3.0
"""Change of speed in m/s^2 that no floor makes: the object has hit something, or was pushed."""
_LONGEST_GAP, _LEAST_GAP = 0.25, 0.02
"""Time in s between two sightings in which an object may have hit something, and in which nothing is new."""
_SHORTEST, _ENOUGH = 0.4, 0.6
"""Free rolling in s that counts, and that must be seen in all."""
_KEPT = 5
"""Stretches of free rolling that are remembered; their median counts."""
_MOST = 400
"""Sightings after which a stretch ends, however long an object rolls."""
_STRAY = 0.15
"""Share by which the way may differ from what the speeds make of it: a resting object that seems to move goes
nowhere, one that is turned aside goes less far."""
_SURE = 3.0
"""Standard errors by which what is seen must differ from what is described."""
_FARTHER, _FARTHEST, _PUSHED = 1.3, 4.0, 6.0
"""How many times as far as described objects must roll to be noticed, are believed to roll at most, and roll
only when they are pushed."""
_FEWEST = 5
"""Sightings of a stretch that counts."""
_ROUNDING = 1e-6  # s
_STEPS = 14
"""Steps of the described deceleration to which corrections are rounded: actions compute tables for each."""

Remembered = Mapping[str, Sequence[Sequence[float]]]
"""By object, the numbers of each `Fit`."""


class Rolling:
    """Watches objects that roll freely, and corrects the description of how they slow down.

    A robot that brakes harder than the object that it pushes loses it; one that expects an object to stop
    early drives to the wrong place. Objects that stop earlier than described do no such harm, and what
    another robot brakes looks like them: that is never corrected.

    Parameters
    ----------
    robot : Robot
        The robot with its scene, as described.
    remembered : mapping, optional
        What `remembered` told before.
    slowest : float
        Speed in m/s below which sightings are too noisy to judge by.

    Raises
    ------
    ValueError
        What is remembered is nothing that `remembered` tells.
    """

    def __init__(
        self, robot: Robot, remembered: Remembered | None = None, *, slowest: float = _SLOWEST
    ) -> None:
        self._described = self._robot = robot
        self._libraries: dict[str, TopLibrary] = {}  # corrected, by action set
        self._slowest = max(slowest, _SLOWEST)
        self._now = {name: _Stretch() for name in robot.scene.objects}
        self._past = {name: _checked((remembered or {}).get(name, ())) for name in robot.scene.objects}
        self._velocities: dict[str, tuple[float, float]] = {}

    def observe(self, world: World) -> None:
        """Take the state `world`; repeated and extrapolated states change nothing."""
        for name, stretch in self._now.items():
            state = world.objects.get(name)
            if state is not None and self._velocities.get(name) == (state.vx, state.vy):
                continue  # the sighting before, perhaps extrapolated: objects that roll become slower
            if state is not None:
                self._velocities[name] = state.vx, state.vy
            if state is None or not self._is_free(world, name, state):
                self._end(name)
            elif stretch.goes_on(world.time, state):
                stretch.add(world.time, state)
            else:
                self._end(name)
                self._now[name].add(world.time, state)

    def remembered(self) -> Remembered:
        """Return all that is known, as plain numbers; a run that is under way ends here."""
        for name in self._now:
            self._end(name)
        return {name: [list(fit) for fit in past] for name, past in self._past.items()}

    def robot(self) -> Robot:
        """Return the robot, its scene corrected where objects roll otherwise; the described one where not."""
        items = self._described.scene.objects
        corrected = dict(items)
        for name in items:
            value = self._seen(name)
            if value is not None:
                corrected[name] = dataclasses.replace(items[name], rolling_deceleration=value)
        if corrected == dict(items):
            self._robot = self._described
        elif corrected != dict(self._robot.scene.objects):
            scene = dataclasses.replace(self._described.scene, objects=corrected)
            self._robot = dataclasses.replace(self._described, scene=scene)
        return self._robot

    def diagnostics(self) -> dict[str, str]:
        """Return by object how it slows down where the description says otherwise."""
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
        """Return whether an object rolls, and is so far from the robot that nothing pushes it."""
        robot, pose = self._described, world.robot.pose
        away = math.hypot(state.x - pose.x, state.y - pose.y)
        near = robot.reach + robot.scene.radius(name) + _CLEAR
        return state.speed >= self._slowest and away > near

    def _end(self, name: str) -> None:
        """Keep what an object has shown since it began to roll freely."""
        now = self._now[name]
        if now.empty:
            return
        fit = now.fit()
        self._now[name] = _Stretch()
        if fit is not None and self._is_likely(name, fit):
            self._past[name].append(fit)

    def _is_likely(self, name: str, fit: Fit) -> bool:
        """Return whether the floor alone can have slowed an object down like that."""
        told = self._described.scene.objects[name].rolling_deceleration
        return fit.deceleration - 2.0 * fit.error > told / _PUSHED

    def _seen(self, name: str) -> float | None:
        """Return the deceleration in m/s^2 that was seen; None where too little was, or what is described."""
        now, told = self._now[name].fit(), self._described.scene.objects[name].rolling_deceleration
        fits = [*self._past[name], *([now] if now is not None and self._is_likely(name, now) else [])]
        if sum(fit.seconds for fit in fits) < _ENOUGH:
            return None
        middle = sorted(fits, key=lambda fit: fit.deceleration)[len(fits) // 2]
        value = middle.deceleration
        if value * _FARTHER >= told or told - value < _SURE * middle.error:
            return None
        return max(round(value / told * _STEPS) / _STEPS, 1.0 / _FARTHEST) * told


class Fit(NamedTuple):
    """A line through the speeds of a stretch: its length in s, deceleration and standard error in m/s^2."""

    seconds: float
    deceleration: float
    error: float


class _Stretch:
    """Sightings of an object in which it rolled freely, one after the other."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, ObjectState]] = []  # times in s

    @property
    def empty(self) -> bool:
        """Whether nothing was seen."""
        return not self._seen

    def goes_on(self, time: float, state: ObjectState) -> bool:
        """Return whether a sighting can follow those before."""
        if not self._seen:
            return True
        before, last = self._seen[-1]
        elapsed = time - before
        if len(self._seen) == _MOST or not 0.0 <= elapsed <= _LONGEST_GAP:
            return False
        return abs(state.speed - last.speed) <= _HIT * max(elapsed, _LEAST_GAP)

    def add(self, time: float, state: ObjectState) -> None:
        """Add a sighting, unless another one was just before."""
        if not self._seen or time - self._seen[-1][0] >= _LEAST_GAP - _ROUNDING:
            self._seen.append((time, state))

    def fit(self) -> Fit | None:
        """Return the line through all of them; None where they are too few, or do not lie on their way."""
        if len(self._seen) < _FEWEST:
            return None
        times = np.array([time for time, _ in self._seen])
        speeds = np.array([state.speed for _, state in self._seen])
        seconds, way = float(times[-1] - times[0]), 0.5 * float((speeds[1:] + speeds[:-1]) @ np.diff(times))
        first, last = self._seen[0][1], self._seen[-1][1]
        gone = math.hypot(last.x - first.x, last.y - first.y)
        if seconds < _SHORTEST or abs(gone - way) > _STRAY * way:
            return None
        at = times - times.mean()
        squares = float(at @ at)
        slope = float(at @ speeds) / squares
        left = speeds - speeds.mean() - slope * at
        error = math.sqrt(float(left @ left) / (len(times) - 2) / squares)
        return Fit(seconds, -slope, error * _alike(left))


def _alike(left: FloatArray) -> float:
    """Return by how much errors grow as neighbours err alike: what filtered sightings, and pushes, leave."""
    total = float(left @ left)
    if total == 0.0:
        return 1.0
    likeness = float(left[1:] @ left[:-1]) / total + 3.0 / len(left)  # on average too low by that
    likeness = min(max(likeness, 0.0), 0.95)
    return math.sqrt((1.0 + likeness) / (1.0 - likeness))


def _checked(remembered: Any) -> deque[Fit]:
    """Return remembered fits; raise ValueError where they are none."""
    try:
        fits = [Fit(*map(float, fit)) for fit in remembered]
    except (TypeError, ValueError) as error:
        raise ValueError(f"expected fits of three numbers, got {short(remembered)}") from error
    if not all(math.isfinite(value) and value >= 0.0 for fit in fits for value in fit):
        raise ValueError(f"expected fits of three numbers of at least 0, got {short(remembered)}")
    return deque(fits, maxlen=_KEPT)
