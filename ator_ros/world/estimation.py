"""The state of objects and of the robot, estimated from reports that may lack, or contradict, velocities.

`VelocityEstimate` and `RobotVelocity` derive velocities that messages lack; `VelocityCheck` and `TwistCheck`
compare reported ones with positions; `ObjectTracker` is a Kalman filter; `Sightings` orders what arrives with
stamps that may be wrong.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ator_ros.geometry import FloatArray, Pose
from ator_ros.world.state import ObjectState, RobotState, World

_SPAN = 0.3
"""Time in s of positions from which a velocity is fitted."""
_LEAST = 0.05
"""Time in s that positions must span; until then the object counts as at rest."""
_FASTEST = 20.0
"""Speed in m/s above which an object was found elsewhere instead of moving: other robots reach 15 m/s."""
_KEPT_POSES = 64
_ROBOT_SPAN = 0.04
"""Least time in s between two poses from which the robot's velocity is derived: one tick at 20 Hz."""
_ROUNDING = 1e-6
_BEYOND_LIMITS = 1.5
"""A robot that seems to move so many times as fast as its limits was found elsewhere, or is turned about."""


class VelocityEstimate:
    """Fits a straight line to the recent positions of one object."""

    def __init__(self) -> None:
        self._sights: deque[tuple[float, float, float]] = deque(maxlen=_KEPT_POSES)

    def state(self, time: float, x: float, y: float) -> ObjectState:
        """Process a position (m) at `time` (s); return it with its velocity.

        Positions older than a jump, or after the present one, as after a reset of time, are forgotten. The
        velocity is that of the middle of the span: of an object that accelerates it is late by 0.15 s.
        """
        if self._sights and not self._continues(time, x, y):
            self._sights.clear()
        if not self._sights or time > self._sights[-1][0]:
            self._sights.append((time, x, y))
        while self._sights[0][0] < time - _SPAN:
            self._sights.popleft()
        return ObjectState(x, y, *self._velocity())

    def _continues(self, time: float, x: float, y: float) -> bool:
        before, old_x, old_y = self._sights[-1]
        elapsed = time - before
        if not 0.0 <= elapsed <= _SPAN:
            return False
        return bool(np.hypot(x - old_x, y - old_y) <= _FASTEST * max(elapsed, _LEAST))

    def _velocity(self) -> tuple[float, float]:
        """Return the slope of the line of least squares through the positions, in m/s."""
        times, xs, ys = np.array(self._sights).T
        if times[-1] - times[0] < _LEAST:
            return 0.0, 0.0
        past = times - times.mean()
        slope = past / (past @ past)
        return float(slope @ xs), float(slope @ ys)


class RobotVelocity:
    """The velocity of a robot by differences of its poses, as along an arc between two of them.

    Parameters
    ----------
    most_v, most_w : float
        The robot's limits in m/s and rad/s. Where one pose is out of the reach of that before, as where a map
        corrects it, the velocity stays as it was.
    """

    def __init__(self, most_v: float, most_w: float) -> None:
        self._most_v, self._most_w = _BEYOND_LIMITS * most_v, _BEYOND_LIMITS * most_w
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=_KEPT_POSES)
        self._velocity, self._jumped = (0.0, 0.0), False

    def state(self, time: float, pose: Pose) -> RobotState:
        """Process a pose at `time` (s); return it with its velocity.

        That is late by half of the time that it was taken over, 0.04 s or what lies between two poses. After
        a gap of more than 0.3 s, or where time goes back, the robot counts as at rest.
        """
        if self._poses and not 0.0 <= time - self._poses[-1][0] <= _SPAN:
            self._poses.clear()
            self._velocity, self._jumped = (0.0, 0.0), False
        if not self._poses or time > self._poses[-1][0]:
            self._poses.append((time, pose))
        while len(self._poses) > 1 and time - self._poses[1][0] > _ROBOT_SPAN - _ROUNDING:
            self._poses.popleft()
        first, before = self._poses[0]
        if time - first > _ROBOT_SPAN - _ROUNDING:
            self._take(before.relative(pose), time - first, (time, pose))
        return RobotState(pose, *self._velocity)

    def _take(self, moved: Pose, elapsed: float, newest: tuple[float, Pose]) -> None:
        """Take the velocity of a motion, unless it is a jump; two jumps in a row are believed."""
        half = moved.yaw / 2.0
        along = moved.x * math.cos(half) + moved.y * math.sin(half)
        chord = math.sin(half) / half if half else 1.0
        v, w = along / chord / elapsed, moved.yaw / elapsed
        sideways = abs(moved.y * math.cos(half) - moved.x * math.sin(half)) / elapsed
        jumps = max(abs(v), sideways) > self._most_v or abs(w) > self._most_w
        if jumps and not self._jumped:
            self._poses.clear()
            self._poses.append(newest)
        else:
            self._velocity = v, w
        self._jumped = jumps


_BASELINE = 0.2
"""Time in s over which velocities are derived from positions; a jump is believed as long."""
_FORGET = 1.0
"""Time in s without a sighting, or without a contradiction, after which earlier ones are forgotten."""
_SLACK = 0.3
"""Difference in m/s that errors of stamps and filters in cameras explain at any speed."""
_SHARE = 0.1
"""Further difference that they explain, as a share of the speed."""
_PUSH = 1.0
"""Acceleration in m/s^2 of an object that rolls freely or is pushed."""
_SIGMAS = 4.0
_KEPT = 256
"""Sights kept at most: while stamps stand, as those of a paused simulation, sights go on coming."""


class VelocityCheck:
    """Replaces velocities that contradict an object's positions.

    A velocity that jumps, as after a push, is believed for 0.2 s; by then the positions must agree. If they
    do not, the velocity is derived from them if they are steady; otherwise, as after an object was placed
    elsewhere, the slower of both velocities is used.

    Parameters
    ----------
    name : str
        Name of the object.
    noise : float
        Standard deviation of the coordinates of a sighting in m.
    velocity_noise : float
        Standard deviation of the components of its velocity in m/s.
    """

    def __init__(self, name: str, noise: float, velocity_noise: float) -> None:
        self._name, self._noise, self._velocity_noise = name, noise, velocity_noise
        self.reset()

    def reset(self) -> None:
        """Forget all sightings and remarks."""
        self._sights: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._doubted = self._contradicted = -math.inf
        self._said = False

    def check(self, time: float, there: ObjectState) -> tuple[ObjectState, str | None]:
        """Process a sighting at `time` (s).

        Returns
        -------
        there : ObjectState
            The sighting with a plausible velocity.
        remark : str or None
            What was wrong with its velocity, once per period of contradictions without a pause of 1 s.
        """
        if self._sights and not 0.0 <= time - self._sights[-1][0] <= _FORGET:
            self._sights.clear()
        while len(self._sights) > 1 and self._sights[1][0] <= time - _BASELINE + _ROUNDING:
            self._sights.popleft()
        self._sights.append((time, there.x, there.y))
        baseline = time - self._sights[0][0]
        if baseline < 0.75 * _BASELINE:
            return there, None
        vx, vy = self._between(0, -1)
        most = self._tolerance(baseline, there.speed, math.hypot(vx, vy))
        if math.hypot(there.vx - vx, there.vy - vy) <= most:
            return there, None
        if time - self._contradicted > _FORGET:
            self._doubted, self._said = time, False
        self._contradicted = time
        if time - self._doubted < _BASELINE - _ROUNDING:
            return there, None
        seen = ObjectState(there.x, there.y, vx, vy)
        believed = seen if self._is_steady(baseline) or seen.speed < there.speed else there
        return believed, self._remark(there, seen)

    def _is_steady(self, baseline: float) -> bool:
        """Return whether the velocities over both halves of the positions agree."""
        if len(self._sights) < 3:
            return False
        middle = len(self._sights) // 2
        first, second = self._between(0, middle), self._between(middle, -1)
        most = self._tolerance(baseline / 2.0, math.hypot(*first), math.hypot(*second))
        return math.dist(first, second) <= most

    def _between(self, first: int, last: int) -> tuple[float, float]:
        """Return the mean velocity in m/s between two sightings."""
        (t0, x0, y0), (t1, x1, y1) = self._sights[first], self._sights[last]
        elapsed = max(t1 - t0, _ROUNDING)
        return (x1 - x0) / elapsed, (y1 - y0) / elapsed

    def _tolerance(self, baseline: float, *speeds: float) -> float:
        """Return the difference of two velocities in m/s that noise, errors of stamps and pushes explain."""
        noise = _SIGMAS * math.hypot(math.sqrt(2.0) * self._noise / baseline, self._velocity_noise)
        return _SLACK + _SHARE * max(speeds) + _PUSH * baseline + noise

    def _remark(self, reported: ObjectState, seen: ObjectState) -> str | None:
        if self._said:
            return None
        self._said = True
        return (
            f"{self._name}.twist.twist.linear: expected about ({seen.vx:.2f}, {seen.vy:.2f}) m/s, as its "
            f"positions tell, got ({reported.vx:.2f}, {reported.vy:.2f}) m/s: not trusted"
        )


_WINDOW = 0.5
"""Time in s over which the motion of a robot's poses is compared with that of its twist."""
_LONGEST_STEP = 0.3
"""Time in s between two messages beyond which the motion between them cannot be derived from the twist."""
_JUMP = 0.3
"""m or rad by which the motion between two messages may differ from that before; more is a corrected pose."""
_LEAST_MOTION = 0.03
"""m or rad in one window up to which a robot counts as at rest."""
_MOST_OFF = 0.015
"""m or rad in one window that filters, slip and late stamps explain at any speed."""
_MOST_SHARE = 0.3
"""Further difference that they explain, as a share of the greater motion."""
_CONFIRMED = 3
"""Windows that must contradict, more than agree, before it is reported: one may be a corrected pose."""


class TwistCheck:
    """Compares the twist in a robot's odometry with the differences of its poses."""

    def __init__(self) -> None:
        self._last: tuple[float, RobotState] | None = None
        self._step = (0.0, 0.0)
        self._windows, self._reported = 0, False
        self._restart()

    def _restart(self) -> None:
        """Begin a window."""
        self._elapsed, self._by_pose, self._by_twist = 0.0, [0.0, 0.0], [0.0, 0.0]

    def contradiction(self, time: float, robot: RobotState) -> str:
        """Process odometry of `time` (s); return how pose and twist contradict each other: once, else ""."""
        last, self._last = self._last, (time, robot)
        if last is None or self._reported:
            return ""
        elapsed = time - last[0]
        moved = last[1].pose.relative(robot.pose)
        half = moved.yaw / 2.0
        step = moved.x * math.cos(half) + moved.y * math.sin(half), moved.yaw
        jumps = any(abs(now - before) > _JUMP for now, before in zip(step, self._step, strict=True))
        self._step = step
        if jumps or not 0.0 <= elapsed <= _LONGEST_STEP:
            self._restart()
            return ""
        twist = (last[1].v + robot.v) / 2.0, (last[1].w + robot.w) / 2.0
        for axis in (0, 1):
            self._by_pose[axis] += step[axis]
            self._by_twist[axis] += twist[axis] * elapsed
        self._elapsed += elapsed
        return self._judge() if self._elapsed >= _WINDOW - _ROUNDING else ""

    def _judge(self) -> str:
        """Judge a window that is complete, and begin the next one."""
        pairs, elapsed = list(zip(self._by_pose, self._by_twist, strict=True)), self._elapsed
        self._restart()
        sizes = [max(abs(pose), abs(twist)) for pose, twist in pairs]
        if max(sizes) <= _LEAST_MOTION:
            return ""  # a robot at rest
        off = [
            abs(pose - twist) - _MOST_SHARE * size for (pose, twist), size in zip(pairs, sizes, strict=True)
        ]
        self._windows = self._windows + 1 if max(off) > _MOST_OFF else max(0, self._windows - 1)
        if self._windows < _CONFIRMED:
            return ""
        self._reported = True
        axis = off.index(max(off))
        (pose, twist), unit = pairs[axis], ("m/s", "rad/s")[axis]
        name = ("twist.linear", "twist.angular")[axis]
        return (
            f"pose and {name} contradict each other: expected about {pose / elapsed:.2f} {unit} from the "
            f"poses, got {twist / elapsed:.2f} {unit}"
        )


_PUSH_SIGMA = 1.0
"""Standard deviation in m/s^2 of the acceleration of a moving object; a tenth of it applies at rest."""
_SURPRISE = 5.0
"""A sighting this many standard deviations off restarts the filter: the object was pushed or moved."""


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
        push = np.array([elapsed**2 / 2.0, elapsed]) * (_PUSH_SIGMA if moves else 0.1 * _PUSH_SIGMA)
        return motion @ self._covariance @ motion.T + np.outer(push, push)


JUMP = 20.0
"""Difference in s of two stamps that means different clocks, unless as much time has passed."""
_STALE = 1.0
"""Time in s for which all stamps must be wrong to mean another clock; after a reset some are of before."""
_AHEAD = 1.0
"""Real s for which all stamps must be ahead: an idle node reads the object first, then odometry of then."""


class StampError(ValueError):
    """An implausible stamp, whose message is ignored; the error says by how much it is off."""


class Sightings:
    """The recent sightings of one object.

    Parameters
    ----------
    name : str
        Name of the object.
    timeout : float
        Age in s, by the stamps, beyond which a sighting is not used. After half of it without a message the
        object is overdue. It may be changed later, as the attribute of this name.
    tracker : ObjectTracker
        Filters the sightings.
    """

    def __init__(self, name: str, timeout: float, tracker: ObjectTracker) -> None:
        self._name, self.timeout, self._tracker = name, timeout, tracker
        self._velocity = VelocityCheck(name, tracker.noise, tracker.velocity_noise)
        self._sights: deque[tuple[float, ObjectState]] = deque(maxlen=_KEPT)
        self._reset: float | None = -math.inf
        """Odometry's first stamp after time was reset; None: not known yet."""
        self._clear()

    def forget(self) -> None:
        """Forget the object because time was reset."""
        self._reset = None
        self._clear()

    def _clear(self) -> None:
        self._sights.clear()
        self._heard, self._stale_since, self._ahead_since = -math.inf, math.inf, math.inf
        self._tracker.reset()
        self._velocity.reset()

    def overdue(self, now: float) -> bool:
        """Return whether no message has arrived for half the timeout until `now`, odometry's newest stamp."""
        return now - self._heard > self.timeout / 2.0 - _ROUNDING

    def add(
        self, time: float, there: ObjectState, now: float | None, pace: float = 1.0, real: float = 0.0
    ) -> str | None:
        """Process a sighting. Its stamp may be old: a late camera still works.

        Parameters
        ----------
        time : float
            Stamp of the sighting in s.
        there : ObjectState
            The object as seen.
        now : float or None
            Odometry's newest stamp in s; None before the first.
        pace : float
            Stamped s that pass in 1 real s.
        real : float
            Real time in s.

        Returns
        -------
        str or None
            A warning that the velocity contradicts the positions and is not used, once per period of that.

        Raises
        ------
        StampError
            Stamps have been ahead of odometry by more than twice the timeout (longer if they run faster than
            real time) for a real second, or far behind for a while. A stamp less far ahead is accepted:
            odometry may have paused, and will catch up. What was on its way when time was reset is not used,
            and is no error, nor is what is ahead for less than that second.
        """
        if now is not None:
            self._reset = now if self._reset is None else self._reset
            most = 2.0 * self.timeout * max(1.0, pace)
            self._ahead_since = min(self._ahead_since, real) if time > now + most else math.inf
            if time > now + most and (now - self._reset <= _STALE or real - self._ahead_since < _AHEAD):
                return None
            self._check_stamp(time, now, most)
            self._heard = now
        checked, remark = self._velocity.check(time, there)
        self._sights.append((time, self._tracker.update(time, checked)))
        return remark

    def _check_stamp(self, time: float, odometry: float, most: float) -> None:
        """Check that a stamp is at most `most` s ahead of odometry, and not far behind for long."""
        if time > odometry + most:
            raise StampError(
                f"{self._name}.header.stamp: expected at most {most:.1f} s more than odometry's "
                f"{odometry:.2f} s, got {time:.2f} s, {time - odometry:.2f} s ahead: another clock, "
                "odometry has ceased, or this machine is too slow"
            )
        if time >= odometry - JUMP:
            self._stale_since = math.inf
            return
        self._stale_since = min(self._stale_since, odometry)
        if odometry - self._stale_since > _STALE:
            raise StampError(
                f"{self._name}.header.stamp: expected about odometry's {odometry:.2f} s, got {time:.2f} s, "
                f"{odometry - time:.2f} s behind: another clock"
            )

    def at(self, time: float) -> ObjectState | None:
        """Return the newest sighting not after odometry's `time`, extrapolated to it; None if there is none.

        Messages of two topics arrive in any order, and a busy node gets only the newest of each. If the only
        recent sighting is a little newer than odometry, it is extrapolated backward.
        """
        # A sighting that arrived before odometry of its stamp counts as received at its stamp.
        self._heard = max([self._heard, *(stamp for stamp, _ in self._sights if stamp <= time)])
        while self._sights and self._sights[0][0] < time - self.timeout:
            self._sights.popleft()
        sights = ((time - stamp, there) for stamp, there in reversed(self._sights))
        recent = [(age, there) for age, there in sights if abs(age) <= self.timeout]
        if not recent:
            return None
        age, there = min(recent, key=lambda sight: (sight[0] < 0.0, abs(sight[0])))
        return there.after(age)
