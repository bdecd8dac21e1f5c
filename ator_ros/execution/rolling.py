"""How far objects roll, as they are seen to: a carpet is not what a description says of the floor."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, World

_CLEAR = 0.02
"""Distance in m from the robot beyond which nothing but the floor slows an object down."""
_SLOWEST = 0.1
"""Speed in m/s below which rolling is not judged."""
_HIT = 3.0
"""Change of speed in m/s^2 that no floor makes: the object has hit something, or was pushed."""
_LONGEST_GAP = 0.25
"""Time in s between two sightings in which an object may have hit something."""
_SHORTEST = 0.4
"""Time in s that an object must roll freely at one time."""
_ENOUGH, _KEPT = 0.6, 5.0
"""Free rolling in s from which on the description is corrected, and that the correction remembers."""
_TOLERANCE = 0.25
"""Share by which objects may roll otherwise than described before the description is corrected."""
_MOST = 400
"""Sightings in a row after which a stretch ends, however long an object rolls."""
_MOST_SHARE = 4.0
"""How many times as far, or as short a way, objects are believed to roll, whatever is seen."""
_STEP = 0.05
"""m/s^2 to which corrections are rounded, as actions compute tables for each of them."""


Remembered = Mapping[str, Sequence[Sequence[float]]]
"""By object, lines through speeds: see `_Fit`."""


class Rolling:
    """Watches objects that roll freely, and corrects the description of how they slow down.

    A robot that brakes harder than the object that it pushes loses it; one that expects an object to stop
    early drives to the wrong place.

    Parameters
    ----------
    robot : Robot
        The robot with its scene, as described.
    remembered : mapping, optional
        What `remembered` told before.
    """

    def __init__(self, robot: Robot, remembered: Remembered | None = None) -> None:
        self._described = self._robot = robot
        self._libraries: dict[int, tuple[TopLibrary, TopLibrary]] = {}
        self._now = {name: _Stretch() for name in robot.scene.objects}
        self._past = {
            name: deque(_Fit(*fit) for fit in (remembered or {}).get(name, ()))
            for name in robot.scene.objects
        }

    def observe(self, world: World) -> None:
        """Take the state `world`; repeated and extrapolated states change nothing."""
        for name, now in tuple(self._now.items()):
            state = world.objects.get(name)
            if state is not None and now.knows(world.time, state):
                continue
            if state is None or not self._is_free(world, name, state):
                self._end(name)
                continue
            if not now.goes_on(world.time, state):
                self._end(name)
            self._now[name].add(world.time, state)

    def copied(self) -> Rolling:
        """Return one that knows the same, for another run from here."""
        other = copy.copy(self)
        other._now = {name: _Stretch() for name in self._now}
        other._past = {name: past.copy() for name, past in self._past.items()}
        return other

    def remembered(self) -> Remembered:
        """Return all that is known, as plain numbers; a run that is under way ends here."""
        for name in self._now:
            self._end(name)
        return {
            name: [[fit.seconds, fit.times, fit.together] for fit in past]
            for name, past in self._past.items()
        }

    def robot(self) -> Robot:
        """Return the robot, its scene corrected where objects roll otherwise; the described one where not."""
        seen = {name: self._seen(name) for name in self._now}
        items = self._described.scene.objects
        corrected = {
            name: items[name]
            if value is None
            else dataclasses.replace(items[name], rolling_deceleration=value)
            for name, value in seen.items()
        }
        if corrected == dict(items):
            self._robot = self._described
        elif corrected != dict(self._robot.scene.objects):
            scene = dataclasses.replace(self._described.scene, objects=corrected)
            self._robot = dataclasses.replace(self._described, scene=scene)
        return self._robot

    def told(self) -> dict[str, str]:
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
        former, library = self._libraries.get(id(described), (described, described))
        if former is not described or library.robot is not robot:
            library = described.with_robot(robot)
            self._libraries[id(described)] = described, library
        return library

    def _is_free(self, world: World, name: str, state: ObjectState) -> bool:
        """Return whether an object rolls, and is so far from the robot that nothing pushes it."""
        robot, pose = self._described, world.robot.pose
        away = math.hypot(state.x - pose.x, state.y - pose.y)
        near = robot.reach + robot.scene.radius(name) + _CLEAR
        return state.speed >= _SLOWEST and away > near

    def _end(self, name: str) -> None:
        """Keep what an object has shown since it began to roll freely."""
        fit, past = self._now[name].fit(), self._past[name]
        self._now[name] = _Stretch()
        if fit.seconds < _SHORTEST:
            return
        past.append(fit)
        while sum(each.seconds for each in past) - past[0].seconds >= _KEPT:
            past.popleft()

    def _seen(self, name: str) -> float | None:
        """Return the deceleration in m/s^2 that was seen; None where too little was, or what is described."""
        now = self._now[name].fit()
        fits = [*self._past[name], *([now] if now.seconds >= _SHORTEST else [])]
        if sum(fit.seconds for fit in fits) < _ENOUGH:
            return None
        value = -sum(fit.together for fit in fits) / sum(fit.times for fit in fits)
        told = self._described.scene.objects[name].rolling_deceleration
        if abs(value - told) <= _TOLERANCE * told:
            return None
        return min(max(_STEP * round(value / _STEP), told / _MOST_SHARE), told * _MOST_SHARE)


@dataclass(frozen=True, slots=True)
class _Fit:
    """A line through speeds: its length in s, and the sums of squares of times, and of times and speeds."""

    seconds: float
    times: float
    together: float


class _Stretch:
    """Sightings of an object in which it rolled freely, one after the other."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, float]] = []  # time in s, speed in m/s
        self._velocity = (0.0, 0.0)

    def knows(self, time: float, state: ObjectState) -> bool:
        """Return whether a sighting is the last one, perhaps extrapolated: objects roll ever more slowly."""
        if not self._seen:
            return False
        same = (state.vx, state.vy) == self._velocity and time <= self._seen[-1][0] + _LONGEST_GAP
        return same or time == self._seen[-1][0]

    def goes_on(self, time: float, state: ObjectState) -> bool:
        """Return whether a sighting can follow those before."""
        if not self._seen:
            return True
        if len(self._seen) == _MOST:
            return False
        before, speed = self._seen[-1]
        elapsed = time - before
        return 0.0 < elapsed <= _LONGEST_GAP and abs(state.speed - speed) <= _HIT * elapsed

    def add(self, time: float, state: ObjectState) -> None:
        """Add a sighting."""
        self._seen.append((time, state.speed))
        self._velocity = state.vx, state.vy

    def fit(self) -> _Fit:
        """Return the line through all of them."""
        if len(self._seen) < 3:
            return _Fit(0.0, 0.0, 0.0)
        times, speeds = zip(*self._seen, strict=True)
        middle, mean = _mean(times), _mean(speeds)
        return _Fit(
            times[-1] - times[0],
            sum((time - middle) ** 2 for time in times),
            sum((time - middle) * (speed - mean) for time, speed in self._seen),
        )


def _mean(values: Iterable[float]) -> float:
    numbers = list(values)
    return sum(numbers) / len(numbers)
