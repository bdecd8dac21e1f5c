"""The states of objects: checked stamps, plausible velocities, a Kalman filter, extrapolation.

`VelocityEstimate` derives missing velocities from positions. `Sightings` processes sightings: a
`VelocityCheck` replaces wrong velocities, and an `ObjectTracker` filters noise.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ator_ros.world.state import ObjectState

_ROUNDING = 1e-6
_KEPT = 256  # most sightings: in a paused simulation they continue with the same stamp
_FORGET = 1.0  # s without a sighting after which earlier ones are forgotten

_SPAN = 0.3  # s of positions from which a velocity is fitted
_LEAST = 0.05  # s that positions must span; until then the object counts as at rest
_FASTEST = 20.0  # m/s above which the position has jumped: other robots reach 15 m/s


class VelocityEstimate:
    """Fits a straight line to the recent positions of one object."""

    def __init__(self) -> None:
        self._positions: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)  # s, m, m

    def state(
        self,
        time: float,
        x: float,
        y: float,
    ) -> ObjectState:
        """Process a position (m) at `time` (s); return it with its velocity, which lags by 0.15 s.

        After a jump of the position, or a reset of time, earlier positions are forgotten.
        """
        positions = self._positions
        if positions:
            last, last_x, last_y = positions[-1]
            elapsed = time - last
            reach = _FASTEST * max(elapsed, _LEAST)
            if not 0.0 <= elapsed <= _SPAN or math.hypot(x - last_x, y - last_y) > reach:
                positions.clear()
        if not positions or time > positions[-1][0]:
            positions.append((time, x, y))
        while positions[0][0] < time - _SPAN:
            positions.popleft()
        return ObjectState(x, y, *self._velocity())

    def _velocity(self) -> tuple[float, float]:
        """Return the velocity in m/s by linear regression."""
        times, xs, ys = np.array(self._positions).T
        if times[-1] - times[0] < _LEAST:
            return 0.0, 0.0
        vx, vy = np.polyfit(times - times.mean(), np.transpose([xs, ys]), 1)[0]
        return float(vx), float(vy)


# s over which velocities are derived from positions; a velocity that jumps is used as long
_BASELINE = 0.2
_SLACK = 0.3  # m/s; difference due to errors of stamps and of filters in cameras
_SHARE = 0.1  # further such difference as a share of the speed
_PUSH = 1.0  # m/s^2 of an object that rolls freely or is pushed
_SIGMAS = 4.0


class VelocityCheck:
    """Replaces velocities that contradict an object's positions.

    A velocity that jumps, as after a push, is used for 0.2 s. If the positions then do not agree,
    the velocity is derived from them.

    `noise` (m) and `velocity_noise` (m/s) are the standard deviations of each component of a
    sighting.
    """

    def __init__(
        self,
        name: str,
        noise: float,
        velocity_noise: float,
    ) -> None:
        self._name = name
        self._noise = noise
        self._velocity_noise = velocity_noise
        self.reset()

    def reset(self) -> None:
        """Forget all sightings and warnings."""
        self._positions: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)  # s, m, m
        self._is_plausible()

    def _is_plausible(self) -> None:
        self._implausible_since = math.inf
        self._reported = False

    def check(self, time: float, sighting: ObjectState) -> tuple[ObjectState, str | None]:
        """Process a sighting at `time` (s); return it with a plausible velocity, and a warning.

        The warning is not repeated until a velocity is plausible again.
        """
        if self._positions and not 0.0 <= time - self._positions[-1][0] <= _FORGET:
            self.reset()
        positions = self._positions
        while len(positions) > 1 and positions[1][0] <= time - _BASELINE + _ROUNDING:
            positions.popleft()
        positions.append((time, sighting.x, sighting.y))
        first, first_x, first_y = positions[0]
        baseline = time - first
        if baseline < 0.75 * _BASELINE:
            return sighting, None
        vx = (sighting.x - first_x) / baseline
        vy = (sighting.y - first_y) / baseline
        difference = math.hypot(sighting.vx - vx, sighting.vy - vy)
        if difference <= self._tolerance(max(sighting.speed, math.hypot(vx, vy)), baseline):
            self._is_plausible()
            return sighting, None
        self._implausible_since = min(self._implausible_since, time)
        if time - self._implausible_since < _BASELINE - _ROUNDING:
            return sighting, None
        warning = None
        if not self._reported:
            warning = (
                f"{self._name}.twist.twist.linear: expected about ({vx:.2f}, {vy:.2f}) m/s, as its "
                f"positions show, got ({sighting.vx:.2f}, {sighting.vy:.2f}) m/s: not trusted"
            )
        self._reported = True
        return ObjectState(sighting.x, sighting.y, vx, vy), warning

    def _tolerance(self, speed: float, baseline: float) -> float:
        """Return by how much (m/s) a velocity may differ from that over `baseline` (s)."""
        by_positions = math.sqrt(2.0) * self._noise / baseline
        noise = _SIGMAS * math.hypot(by_positions, self._velocity_noise)
        return _SLACK + _SHARE * speed + _PUSH * baseline + noise


# m/s^2; standard deviation of the acceleration of a moving object, a tenth of it at rest
_PUSH_SIGMA = 1.0
# standard deviations above which the filter restarts: the object was pushed or moved
_SURPRISE = 5.0


class ObjectTracker:
    """A Kalman filter for the sightings of one object, which restarts when they jump.

    Both coordinates share one covariance, because noise and pushes are the same for both. `noise`
    (m) and `velocity_noise` (m/s) are the standard deviations of each component of a sighting. With
    a noise of 0 nothing is filtered; otherwise both are above 0.
    """

    def __init__(self, noise: float, velocity_noise: float) -> None:
        self.noise = noise
        self.velocity_noise = velocity_noise
        self._seen = np.diag([noise**2, velocity_noise**2])
        self._exact = noise == 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the object."""
        self._time = -math.inf
        self._state = np.zeros((2, 2))  # rows: position, velocity; columns: x, y
        self._covariance = self._seen

    def update(self, time: float, sighting: ObjectState) -> ObjectState:
        """Process a sighting at `time` (s); return the filtered state.

        A sighting with the time of the last one is ignored, unless it jumps.
        """
        if self._exact:
            return sighting
        measured = np.array([[sighting.x, sighting.y], [sighting.vx, sighting.vy]])
        elapsed = time - self._time
        known = 0.0 <= elapsed <= _FORGET
        if not known:
            elapsed = 0.0
        motion = np.array([[1.0, elapsed], [0.0, 1.0]])
        expected = motion @ self._state
        speed = math.hypot(*self._state[1])
        moves = speed > 3.0 * math.sqrt(self._seen[1, 1])
        acceleration = _PUSH_SIGMA if moves else 0.1 * _PUSH_SIGMA
        push = np.array([elapsed**2 / 2.0, elapsed]) * acceleration
        covariance = motion @ self._covariance @ motion.T + np.outer(push, push)
        spread = np.sqrt(np.diag(covariance + self._seen))
        if not known or np.any(np.abs(measured - expected) > _SURPRISE * spread[:, None]):
            self._state = measured
            self._covariance = self._seen
        elif elapsed > 0.0:
            gain = covariance @ np.linalg.inv(covariance + self._seen)
            self._state = expected + gain @ (measured - expected)
            self._covariance = (np.eye(2) - gain) @ covariance
        self._time = time
        (x, y), (vx, vy) = self._state.tolist()
        return ObjectState(x, y, vx, vy)


JUMP = 20.0
"""Difference in s of two stamps above which their clocks differ, unless as much time has passed."""
_OFF = 1.0
"""Real s for which all stamps must be wrong.

An idle node reads the object before odometry of the same time, and after a reset some messages are
older than it.
"""


class StampError(ValueError):
    """An implausible stamp, whose message is ignored."""


class Sightings:
    """The recent sightings of one object.

    The attribute `timeout` is the age in s, by the stamps, above which a sighting is not used.
    After half of it without a message the object is overdue.
    """

    def __init__(
        self,
        name: str,
        timeout: float,
        tracker: ObjectTracker,
    ) -> None:
        self._name = name
        self.timeout = timeout
        self._tracker = tracker
        self._velocity = VelocityCheck(name, tracker.noise, tracker.velocity_noise)
        self._sightings: deque[tuple[float, ObjectState]] = deque(maxlen=_KEPT)
        self.forget()

    def forget(self) -> None:
        """Forget the object because time was reset."""
        self._sightings.clear()
        self._received = -math.inf
        self._off_since = math.inf
        self._tracker.reset()
        self._velocity.reset()

    def overdue(self, now: float) -> bool:
        """Return whether no message arrived in half the timeout before odometry's newest stamp."""
        return now - self._received > self.timeout / 2.0 - _ROUNDING

    def add(
        self,
        time: float,
        sighting: ObjectState,
        now: float | None,
        pace: float = 1.0,
        real: float = 0.0,
    ) -> str | None:
        """Process a sighting with the stamp `time` (s), which may be old; return a warning or None.

        Parameters
        ----------
        now : float or None
            Odometry's newest stamp in s; None before the first.
        pace : float
            Stamped s that pass in 1 real s.
        real : float
            Real time in s.

        Raises
        ------
        StampError
            For a real second, stamps have been ahead of odometry by more than twice the timeout
            (longer if they run faster than real time), or behind by more than `JUMP`. Within that
            second such sightings are ignored. Stamps less far ahead are accepted: odometry may have
            paused, and will catch up.
        """
        if now is not None:
            most = 2.0 * self.timeout * max(1.0, pace)
            off = not now - JUMP <= time <= now + most
            self._off_since = min(self._off_since, real) if off else math.inf
            if off and real - self._off_since < _OFF:
                return None
            if off:
                error = f"{time - now:.2f} s ahead" if time > now else f"{now - time:.2f} s behind"
                raise StampError(
                    f"{self._name}.header.stamp: expected about odometry's {now:.2f} s, "
                    f"got {time:.2f} s, "
                    f"{error}: another clock, odometry has ceased, or this machine is too slow"
                )
            self._received = now
        checked, warning = self._velocity.check(time, sighting)
        self._sightings.append((time, self._tracker.update(time, checked)))
        return warning

    def at(self, time: float) -> ObjectState | None:
        """Return the newest sighting not after odometry's `time`, extrapolated to it, or None.

        Messages of two topics arrive in any order, and a busy node gets only the newest of each. A
        sighting that is newer than odometry is extrapolated backward if it is the only recent one.
        """
        # A sighting that arrived before odometry of its stamp counts as received at its stamp.
        self._received = max(
            [self._received, *(stamp for stamp, _ in self._sightings if stamp <= time)]
        )
        while self._sightings and self._sightings[0][0] < time - self.timeout:
            self._sightings.popleft()
        ages = ((time - stamp, sighting) for stamp, sighting in reversed(self._sightings))
        recent = [(age, sighting) for age, sighting in ages if abs(age) <= self.timeout]
        if not recent:
            return None
        age, sighting = min(recent, key=lambda item: (item[0] < 0.0, abs(item[0])))
        return sighting.after(age)
