"""Combines odometry and sightings of objects, which arrive in separate messages, into one state."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

from ator_ros.world.delay import Delay
from ator_ros.world.sightings import JUMP, Sightings, StampError
from ator_ros.world.state import ObjectState, RobotState, World

# greatest plausible ratio of simulated to real time; simulations run at a few hundred
_FASTEST = 1000.0
_LONGEST = 1.0  # longest real s without odometry to which that ratio applies
# real s over which the pace of stamps is measured, and between samples
_PACE_WINDOW = 2.0
_PACE_STEP = 0.1
_PACE_LEAST = 0.5  # least real s to measure it over: messages 0.05 s late then change it by a tenth
_REAL_TIME = 0.8  # pace below which stamps run slower than real time, as in a slow simulation
_FASTER_THAN_REAL = 1.5  # pace above that of messages which were delayed for a moment
_SLOWEST = 50.0  # greatest factor of timeouts, for a simulation at 0.02 times real time
GAP = 1.0
"""Real time in s without odometry after which the base may have been restarted."""


class ClockJumpError(ValueError):
    """Odometry whose clock has jumped, as after a reset; the message contains both times."""


class Inputs:
    """The newest state of the robot, with the states of the objects at the same time."""

    def __init__(self, objects: Mapping[str, Sightings]) -> None:
        self._objects = objects
        self.time: float | None = None
        """Stamp of the newest odometry in s; None before the first."""
        self._suspect: float | None = None  # stamp of the last message, if it was rejected
        # real time in s of the last message that was older than the one before
        self._older_at = -math.inf
        self._received = 0.0  # real time in s of the last message
        self.since = -math.inf
        """Real time in s since which odometry has arrived without a gap of more than `GAP`."""
        # real time and stamp (s) of recent messages
        self._clocks: deque[tuple[float, float]] = deque()
        self.pace = 1.0
        """Stamped s that pass in 1 real s, over the last seconds."""
        self.delay = Delay()

    @property
    def overdue(self) -> frozenset[str]:
        """Names of the objects that have been missing for so long that the robot should stand."""
        now = self.time
        return frozenset(
            name for name, item in self._objects.items() if now is None or item.overdue(now)
        )

    def set_timeouts(self, settings: Mapping[str, float]) -> None:
        """Set the timeouts of objects that `settings` contains as NAME_timeout in s."""
        for name, sightings in self._objects.items():
            sightings.timeout = settings.get(f"{name}_timeout", sightings.timeout)

    def object(
        self,
        name: str,
        time: float,
        sighting: ObjectState,
        now: float = 0.0,
    ) -> str | None:
        """Process a sighting of an object, at `now` in real s; see `Sightings.add`."""
        return self._objects[name].add(time, sighting, self.time, self.pace, now)

    def robot(
        self,
        time: float,
        robot: RobotState,
        now: float = 0.0,
    ) -> World | None:
        """Process odometry with the stamp `time` (s); return the world, None if it did not advance.

        The real time `now` (s) limits by how much the stamp may have advanced. One message that is
        older than the last one was late and is ignored.

        Raises
        ------
        StampError
            The stamp is far ahead of the last one, or again older than it within a second: the
            message is ignored. The next one may confirm it.
        ClockJumpError
            The second stamp in a row is older than the last one, or confirms a clock far ahead. All
            objects are forgotten and the new clock is used.
        """
        last = self.time
        most = JUMP + _FASTEST * min(now - self._received, _LONGEST)
        if now - self._received > GAP * self.slowdown:
            self.since = now
        self._received = now
        if last is not None and not 0.0 <= time - last <= most:
            self._reject(time, last, most, now)
            return None
        if time != last:
            self._measure_pace(time, now)
            self.delay.update(time, now)
        self.time = time
        self._suspect = None
        states = {name: sightings.at(time) for name, sightings in self._objects.items()}
        objects = {name: state for name, state in states.items() if state is not None}
        return None if time == last else World(time, robot, objects)

    @property
    def slowdown(self) -> float:
        """Factor for timeouts in real time: above 1 if stamps run slower than real time."""
        return min(1.0 / self.pace, _SLOWEST) if 0.0 < self.pace < _REAL_TIME else 1.0

    @property
    def is_fast(self) -> bool:
        """Whether stamps run faster than real time, as only in a simulation."""
        return self.pace > _FASTER_THAN_REAL

    def _measure_pace(self, time: float, now: float) -> None:
        clocks = self._clocks
        if clocks:
            last_now, last_time = clocks[-1]
            if time - last_time < 0.5 * (now - last_now) / _SLOWEST:
                clocks.clear()  # slower than any simulation: it was paused and keeps its pace
        if not clocks or now - clocks[-1][0] >= _PACE_STEP:
            clocks.append((now, time))
        while len(clocks) > 2 and now - clocks[1][0] >= _PACE_WINDOW:
            clocks.popleft()
        first_now, first_time = clocks[0]
        real = now - first_now
        stamped = time - first_time
        if real >= _PACE_LEAST and stamped > 0.0:
            self.pace = stamped / real

    def _reject(
        self,
        time: float,
        last: float,
        most: float,
        now: float,
    ) -> None:
        """Ignore odometry older than the `last`, or `most` s newer, unless it is confirmed."""
        before = self._suspect
        self._suspect = time
        if before is not None and 0.0 <= time - before <= most:
            self.time = time
            self._suspect = None
            self._clocks.clear()
            self.delay.restart()
            for sightings in self._objects.values():
                sightings.forget()
            jump = (
                f"jumped {time - last:.2f} s ahead"
                if time > last
                else f"went back {last - time:.2f} s"
            )
            raise ClockJumpError(
                f"time {jump}: expected odometry soon after {last:.2f} s, got {time:.2f} s: "
                f"a reset, another "
                "clock, or two nodes that publish it"
            )
        if time > last:
            raise StampError(
                f"odom.header.stamp: expected soon after {last:.2f} s, got {time:.2f} s, "
                f"{time - last:.2f} s ahead: another clock, or odometry had ceased"
            )
        again = now - self._older_at < GAP
        self._older_at = now
        if again:
            raise StampError(
                f"odom.header.stamp: expected after {last:.2f} s, got {time:.2f} s: "
                f"messages often arrive "
                "out of order, or two nodes publish it"
            )
