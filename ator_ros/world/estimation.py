"""The state of objects and of the robot, estimated from messages whose velocities may be missing or wrong.

`VelocityEstimate` and `RobotVelocity` derive missing velocities; `VelocityCheck` and `TwistCheck`
compare reported ones with positions; `SenderCheck` recognizes two senders; `ObjectTracker` is a
Kalman filter; `Sightings` checks stamps.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable

import numpy as np

from ator_ros.geometry import FloatArray, Pose
from ator_ros.world.state import ObjectState, RobotState

_SPAN = 0.3  # s of positions from which a velocity is fitted
_LEAST = 0.05  # s that positions must span; until then the object counts as at rest
_FASTEST = 20.0  # m/s above which the position has jumped: other robots reach 15 m/s
_KEPT_POSES = 64
# s; least time between poses from which a velocity is derived, one tick at 20 Hz
_ROBOT_SPAN = 0.04
_ROUNDING = 1e-6
_BEYOND_LIMITS = 1.5  # times a robot's limits, above which its pose has jumped


class VelocityEstimate:
    """Fits a straight line to the recent positions of one object."""

    def __init__(self) -> None:
        self._sightings: deque[tuple[float, float, float]] = deque(maxlen=_KEPT_POSES)

    def state(self, time: float, x: float, y: float) -> ObjectState:
        """Process a position (m) at `time` (s); return it with its velocity, which lags by up to 0.15 s.

        After a jump of the position, or a reset of time, earlier positions are forgotten.
        """
        if self._sightings:
            before, old_x, old_y = self._sightings[-1]
            reach = _FASTEST * max(time - before, _LEAST)
            if not 0.0 <= time - before <= _SPAN or math.hypot(x - old_x, y - old_y) > reach:
                self._sightings.clear()
        if not self._sightings or time > self._sightings[-1][0]:
            self._sightings.append((time, x, y))
        while self._sightings[0][0] < time - _SPAN:
            self._sightings.popleft()
        return ObjectState(x, y, *self._velocity())

    def _velocity(self) -> tuple[float, float]:
        """Return the velocity in m/s by linear regression."""
        times, xs, ys = np.array(self._sightings).T
        if times[-1] - times[0] < _LEAST:
            return 0.0, 0.0
        vx, vy = np.polyfit(times - times.mean(), np.transpose([xs, ys]), 1)[0]
        return float(vx), float(vy)


class RobotVelocity:
    """The velocity of a robot along the arc between two poses.

    `most_v` and `most_w` are the robot's limits in m/s and rad/s. If the pose jumps, as when a
    localization corrects it, the velocity does not change.
    """

    def __init__(self, most_v: float, most_w: float) -> None:
        self._most_v, self._most_w = _BEYOND_LIMITS * most_v, _BEYOND_LIMITS * most_w
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=_KEPT_POSES)
        self._velocity = (0.0, 0.0)
        self._jump: FloatArray | None = None  # the last motion, if it was a jump

    def state(self, time: float, pose: Pose) -> RobotState:
        """Process a pose at `time` (s); return it with its velocity, the mean of 0.04 s or between two poses.

        After a gap of more than 0.3 s, or a reset of time, the robot counts as at rest.
        """
        if self._poses and not 0.0 <= time - self._poses[-1][0] <= _SPAN:
            self._poses.clear()
            self._velocity, self._jump = (0.0, 0.0), None
        if not self._poses or time > self._poses[-1][0]:
            self._poses.append((time, pose))
        while len(self._poses) > 1 and time - self._poses[1][0] > _ROBOT_SPAN - _ROUNDING:
            self._poses.popleft()
        first, before = self._poses[0]
        if time - first > _ROBOT_SPAN - _ROUNDING:
            self._update(before.relative(pose), time - first, (time, pose))
        return RobotState(pose, *self._velocity)

    def _update(self, moved: Pose, elapsed: float, newest: tuple[float, Pose]) -> None:
        """Use the velocity of a motion, unless it is a jump.

        After two jumps in a row the second is used if it continues the first. Jumps to and fro are
        those of two senders.
        """
        length, sideways = _arc(moved)
        v, w = length / elapsed, moved.yaw / elapsed
        jumps = max(abs(v), abs(sideways) / elapsed) > self._most_v or abs(w) > self._most_w
        jump = np.array([moved.x, moved.y, moved.yaw]) / elapsed if jumps else None
        before, self._jump = self._jump, jump
        if jump is not None and (before is None or not _continues(before, jump)):
            self._poses.clear()
            self._poses.append(newest)
        else:
            self._velocity = v, w


def _continues(before: FloatArray, jump: FloatArray) -> bool:
    """Return whether two motions (m/s, rad/s) are about the same."""
    return bool(np.linalg.norm(jump - before) <= 0.5 * np.linalg.norm(before))


def _arc(moved: Pose) -> tuple[float, float]:
    """Return the length in m of the arc to a pose ahead, and how far the pose lies beside it in m."""
    half = moved.yaw / 2.0
    along = moved.x * math.cos(half) + moved.y * math.sin(half)
    sideways = moved.y * math.cos(half) - moved.x * math.sin(half)
    return along / (math.sin(half) / half if half else 1.0), sideways


# s over which velocities are derived from positions; a velocity that jumps is used as long
_BASELINE = 0.2
_FORGET = 1.0  # s without a sighting after which earlier ones are forgotten
_SLACK = 0.3  # m/s; difference due to errors of stamps and of filters in cameras
_SHARE = 0.1  # further such difference as a share of the speed
_PUSH = 1.0  # m/s^2 of an object that rolls freely or is pushed
_SIGMAS = 4.0
# greatest number of sightings: in a paused simulation they continue with the same stamp
_KEPT = 256


class VelocityCheck:
    """Replaces velocities that contradict an object's positions.

    A velocity that jumps, as after a push, is used for 0.2 s. If the positions then do not agree,
    the velocity is derived from them.

    `noise` (m) and `velocity_noise` (m/s) are the standard deviations of each component of a
    sighting.
    """

    def __init__(self, name: str, noise: float, velocity_noise: float) -> None:
        self._name, self._noise, self._velocity_noise = name, noise, velocity_noise
        self.reset()

    def reset(self) -> None:
        """Forget all sightings and warnings."""
        self._sightings: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._implausible_since, self._reported = math.inf, False

    def check(self, time: float, sighting: ObjectState) -> tuple[ObjectState, str | None]:
        """Process a sighting at `time` (s); return it with a plausible velocity, and a warning or None.

        The warning is not repeated until a velocity is plausible again.
        """
        if self._sightings and not 0.0 <= time - self._sightings[-1][0] <= _FORGET:
            self.reset()
        while len(self._sightings) > 1 and self._sightings[1][0] <= time - _BASELINE + _ROUNDING:
            self._sightings.popleft()
        self._sightings.append((time, sighting.x, sighting.y))
        baseline = time - self._sightings[0][0]
        if baseline < 0.75 * _BASELINE:
            return sighting, None
        _, first_x, first_y = self._sightings[0]
        vx, vy = (sighting.x - first_x) / baseline, (sighting.y - first_y) / baseline
        noise = _SIGMAS * math.hypot(math.sqrt(2.0) * self._noise / baseline, self._velocity_noise)
        most = _SLACK + _SHARE * max(sighting.speed, math.hypot(vx, vy)) + _PUSH * baseline + noise
        if math.hypot(sighting.vx - vx, sighting.vy - vy) <= most:
            self._implausible_since, self._reported = math.inf, False
            return sighting, None
        self._implausible_since = min(self._implausible_since, time)
        if time - self._implausible_since < _BASELINE - _ROUNDING:
            return sighting, None
        reported, self._reported = self._reported, True
        warning = (
            f"{self._name}.twist.twist.linear: expected about ({vx:.2f}, {vy:.2f}) m/s, as its "
            f"positions show, got ({sighting.vx:.2f}, {sighting.vy:.2f}) m/s: not trusted"
        )
        return ObjectState(sighting.x, sighting.y, vx, vy), None if reported else warning


_LEAST_DISTANCE = 0.02  # m between two senders of a topic; the noise of odometry is below
# m between two senders in tf: detections of depth cameras, and corrections of localization, flip by
# the 3 to 5 cm of a cell
_LEAST_IN_TF = 0.2
LEAST_IN_ODOMETRY = 0.04
"""Distance in m of two senders of a frame in odom, which moves without jumps (REP-105)."""
# least share of a jump by which both neighbors seem to jump back: simulated senders, every second
# to fifth message of one of them, with uneven stamps, reach it
_LEAST_RETURN = 0.1
_MOST_VARIATION = 0.3  # greatest share by which jumps differ: by 0.25 with the same uneven stamps
# jumps of this kind in a row: white noise of one sender made at most 7 in 30,000 messages
_FEWEST_JUMPS = 8
# s without such a jump after which one of the two has ended; also a sender of 1 Hz has not
_LONGEST_PAUSE = 1.5


class SenderCheck:
    """Recognizes that positions come from two senders.

    The graph of ROS is the condition: `is_shared` returns whether it lists two publishers of the
    topic. The positions confirm that both send: they jump to and fro, always as far. Positions of
    one sender may do so, too, as those of a camera whose depths are rounded, and the graph lists
    publishers that have ended for up to 20 s.

    Without `is_shared`, as in tf, whose senders are unknown, jumps of at least `least` m count
    alone.
    """

    def __init__(
        self, is_shared: Callable[[], bool] | None = None, *, least: float = _LEAST_IN_TF
    ) -> None:
        self._is_shared = is_shared
        self._least = least if is_shared is None else _LEAST_DISTANCE
        self._positions: deque[tuple[float, float, float]] = deque(maxlen=3)  # s, m, m
        # differences of positions from the lines between those before and after
        self._deviations: deque[tuple[float, float]] = deque(maxlen=3)
        self._jump = (0.0, 0.0)  # m; the last one
        self._jumped_at = -math.inf  # s
        self._jumps = 0

    def distance(self, time: float, x: float, y: float) -> float:
        """Process a position (m) at `time` (s); return the distance of two senders in m, 0 of one."""
        self._positions.append((time, x, y))
        if len(self._positions) == 3:
            self._deviations.append(_deviation(*self._positions))
        if len(self._deviations) == 3:
            self._count(time, *self._deviations)
        if abs(time - self._jumped_at) > _LONGEST_PAUSE:
            self._jumps = 0
        jumps = self._jumps >= _FEWEST_JUMPS
        is_shared = jumps and (self._is_shared is None or self._is_shared())
        return math.hypot(*self._jump) if is_shared else 0.0

    def _count(
        self,
        time: float,
        before: tuple[float, float],
        jump: tuple[float, float],
        after: tuple[float, float],
    ) -> None:
        """Count the jump in the middle of three differences if it is one to another sender."""
        size = math.hypot(*jump)
        back = min(-_dot(jump, before), -_dot(jump, after))
        if size < self._least or back < _LEAST_RETURN * size * size:
            return
        # From the first sender to the second it points the other way than back.
        sign = math.copysign(1.0, _dot(jump, self._jump))
        differs = math.hypot(jump[0] - sign * self._jump[0], jump[1] - sign * self._jump[1])
        self._jumps = self._jumps + 1 if differs <= _MOST_VARIATION * size else 1
        self._jump = jump
        self._jumped_at = time


class PoseSenderCheck:
    """Recognizes that poses come from two senders, which may differ in their heading only.

    `is_shared` and `least` (m, of positions): see `SenderCheck`.
    """

    def __init__(
        self, is_shared: Callable[[], bool] | None = None, *, least: float = _LEAST_IN_TF
    ) -> None:
        self._positions = SenderCheck(is_shared, least=least)
        self._headings = SenderCheck(is_shared)

    def difference(self, time: float, x: float, y: float, yaw: float) -> str:
        """Process a pose (m, rad) at `time` (s); return the difference of two senders with its unit.

        It is empty for one sender.
        """
        distance = self._positions.distance(time, x, y)
        # A heading is a position on the circle of radius 1 m, where 0.2 m are 0.2 rad.
        chord = self._headings.distance(time, math.cos(yaw), math.sin(yaw))
        if distance > 0.0:
            return f"{distance:.2f} m"
        return f"{2.0 * math.asin(min(0.5 * chord, 1.0)):.2f} rad" if chord > 0.0 else ""


def _deviation(
    before: tuple[float, float, float],
    here: tuple[float, float, float],
    after: tuple[float, float, float],
) -> tuple[float, float]:
    """Return how far a position lies from the line between two others, by their times (s)."""
    span = after[0] - before[0]
    share = min(max((here[0] - before[0]) / span, 0.0), 1.0) if span > 0.0 else 0.5
    x, y = (here[axis] - before[axis] - share * (after[axis] - before[axis]) for axis in (1, 2))
    return x, y


def _dot(one: tuple[float, float], other: tuple[float, float]) -> float:
    return one[0] * other[0] + one[1] * other[1]


_WINDOW = 0.5  # s over which the motion of a robot's poses is compared with that of its twist
_LONGEST_STEP = 0.3  # s between two messages above which their twists do not determine the motion
_LEAST_MOTION = 0.03  # m or rad in one window up to which a robot counts as at rest
_MOST_OFF = 0.015  # m or rad in one window; difference due to filters, slip and late stamps
TWIST_TOLERANCE = 0.3
"""Share of the greater motion by which pose and twist may differ: filters, slip and late stamps."""
# motion that no ground robot makes: its pose was corrected, or a simulation placed it
_FASTEST_V, _FASTEST_W = 20.0, 50.0  # m/s, rad/s
# excess of contradicting over agreeing windows before a report: one may be a corrected pose
_CONFIRMED = 3
_SIGN_SPAN = 0.1  # s over which the signs of both motions are compared
_LEAST_SIGNED = 0.003  # m or rad in one step: more than the noise of a robot at rest
_MEDIAN_OF = 3  # steps between poses whose median is the velocity: one may be a corrected pose


class TwistCheck:
    """Replaces velocities in a robot's odometry that contradict its poses.

    A velocity with the wrong sign is corrected at once. Other ones are derived from the poses once
    three steps in a row of at least 0.04 s contradict them. If the poses hardly move in these
    steps, wheels may slip: then the poses decide after 1.5 s. The twist is used again once both
    agree for half a second.
    """

    def __init__(self) -> None:
        self._last: tuple[float, RobotState] | None = None
        self._reported = False
        self._windows = [0, 0]  # of driving and of turning
        self._contradictions = _Contradictions(), _Contradictions()
        self._restart()

    def _restart(self) -> None:
        # rows: by poses, by twist; columns: m, rad
        self._elapsed, self._motion = 0.0, np.zeros((2, 2))
        self._step = _MotionStep(0.0, np.zeros((2, 2)))
        self._steps: deque[_MotionStep] = deque(maxlen=_MEDIAN_OF)
        for contradictions in self._contradictions:
            contradictions.restart()

    def check(self, time: float, robot: RobotState) -> tuple[RobotState, str]:
        """Process odometry of `time` (s); return the state to use, and a remark.

        The remark says once how pose and twist contradict each other, else it is empty.
        """
        last, self._last = self._last, (time, robot)
        if last is None:
            return robot, ""
        elapsed, before = time - last[0], last[1]
        if not 0.0 <= elapsed <= _LONGEST_STEP:
            self._restart()
            return robot, ""
        if elapsed == 0.0:
            return robot, ""
        moved = before.pose.relative(robot.pose)
        least = max(math.hypot(moved.x, moved.y) / _FASTEST_V, abs(moved.yaw) / _FASTEST_W)
        if elapsed < least:  # it was placed there
            self._restart()
            return robot, ""
        reported = 0.5 * elapsed * np.array([before.v + robot.v, before.w + robot.w])
        motion = np.array([(_arc(moved)[0], moved.yaw), reported])
        self._add_step(elapsed, motion)
        self._elapsed += elapsed
        self._motion = self._motion + motion
        remark = self._judge() if self._elapsed >= _WINDOW - _ROUNDING else ""
        v, w = (self._velocity(axis, value) for axis, value in enumerate((robot.v, robot.w)))
        return dataclasses.replace(robot, v=v, w=w), remark

    def _add_step(self, elapsed: float, motion: FloatArray) -> None:
        """Add the motion between two messages; the noise of shorter steps would be too large."""
        step = _MotionStep(self._step.elapsed + elapsed, self._step.motion + motion)
        self._step = step
        if step.elapsed < _ROBOT_SPAN - _ROUNDING:
            return
        self._step = _MotionStep(0.0, np.zeros((2, 2)))
        self._steps.append(step)
        for axis, contradictions in enumerate(self._contradictions):
            by_pose, by_twist = step.motion[:, axis].tolist()
            contradictions.add(by_pose, by_twist)

    def _judge(self) -> str:
        """Compare both motions of a window; return a remark, once."""
        elapsed, motion = self._elapsed, self._motion
        self._elapsed, self._motion = 0.0, np.zeros((2, 2))
        sizes = np.abs(motion).max(axis=0)
        if sizes.max() <= _LEAST_MOTION:
            return ""  # a robot at rest
        off = np.abs(motion[0] - motion[1]) - TWIST_TOLERANCE * sizes
        for axis in (0, 1):
            contradicts = bool(off[axis] > _MOST_OFF)
            change = 1 if contradicts else -1
            self._windows[axis] = min(max(0, self._windows[axis] + change), _CONFIRMED)
            if not contradicts and sizes[axis] > _LEAST_MOTION:
                self._contradictions[axis].confirmed = False
        axis = int(off.argmax())
        if self._reported or self._windows[axis] < _CONFIRMED:
            return ""
        self._reported = True
        by_pose, by_twist = motion[:, axis] / elapsed
        name, unit = (("twist.linear", "m/s"), ("twist.angular", "rad/s"))[axis]
        return (
            f"pose and {name} contradict each other: expected about {by_pose:.2f} {unit} from the poses, "
            f"got {by_twist:.2f} {unit}"
        )

    def _velocity(self, axis: int, reported: float) -> float:
        """Return the velocity of driving (0) or turning (1) in m/s or rad/s."""
        if self._contradictions[axis].confirmed or self._windows[axis] == _CONFIRMED:
            speeds = [step.motion[0, axis] / step.elapsed for step in self._steps]
            return float(np.median(speeds)) if speeds else reported
        return -reported if reported and self._has_wrong_sign(axis) else reported

    def _has_wrong_sign(self, axis: int) -> bool:
        """Return whether the robot has moved as far as reported, but in the other direction."""
        span, moved, reported = 0.0, 0.0, 0.0
        for step in reversed(self._steps):
            by_pose, by_twist = step.motion[:, axis]
            if by_pose * by_twist >= 0.0:
                return False
            span, moved, reported = span + step.elapsed, moved + by_pose, reported + by_twist
            if span >= _SIGN_SPAN - _ROUNDING:
                least, most = sorted((abs(moved), abs(reported)))
                return bool(least >= _LEAST_SIGNED and least >= 0.5 * most)
        return False


@dataclasses.dataclass(frozen=True, slots=True)
class _MotionStep:
    """The motion of a robot during some messages."""

    elapsed: float  # s
    motion: FloatArray  # rows: by poses, by twist; columns: m, rad


class _Contradictions:
    """The last steps in a row in which poses and twist contradict each other on one axis."""

    def __init__(self) -> None:
        self.confirmed = False
        self.restart()

    def restart(self) -> None:
        """Forget these steps."""
        self._steps = 0
        self._off = 0.0  # sum of the differences in m or rad
        self._moved = 0.0  # sum of the motion by poses

    def add(self, by_pose: float, by_twist: float) -> None:
        """Add the motion of a step in m or rad."""
        off = by_pose - by_twist
        contradicts = abs(off) > TWIST_TOLERANCE * max(abs(by_pose), abs(by_twist))
        if not contradicts or off * self._off < 0.0:
            self.restart()
        if not contradicts:
            return
        self._steps += 1
        self._off += off
        self._moved += by_pose
        moves = abs(self._moved) >= _LEAST_SIGNED * self._steps
        if self._steps >= _CONFIRMED and abs(self._off) >= _LEAST_MOTION and moves:
            self.confirmed = True


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
        self.noise, self.velocity_noise = noise, velocity_noise
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
        known = 0.0 <= time - self._time <= _FORGET
        elapsed = time - self._time if known else 0.0
        motion = np.array([[1.0, elapsed], [0.0, 1.0]])
        expected = motion @ self._state
        moves = math.hypot(*self._state[1]) > 3.0 * math.sqrt(self._seen[1, 1])
        push = np.array([elapsed**2 / 2.0, elapsed]) * (_PUSH_SIGMA if moves else 0.1 * _PUSH_SIGMA)
        covariance = motion @ self._covariance @ motion.T + np.outer(push, push)
        spread = np.sqrt(np.diag(covariance + self._seen))
        if not known or np.any(np.abs(measured - expected) > _SURPRISE * spread[:, None]):
            self._state, self._covariance = measured, self._seen
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
"""Real s for which all stamps must be wrong: an idle node reads the object before odometry of the same time,
and after a reset some messages are older than it."""


class StampError(ValueError):
    """An implausible stamp, whose message is ignored."""


class Sightings:
    """The recent sightings of one object.

    The attribute `timeout` is the age in s, by the stamps, above which a sighting is not used.
    After half of it without a message the object is overdue.
    """

    def __init__(self, name: str, timeout: float, tracker: ObjectTracker) -> None:
        self._name, self.timeout, self._tracker = name, timeout, tracker
        self._velocity = VelocityCheck(name, tracker.noise, tracker.velocity_noise)
        self._sightings: deque[tuple[float, ObjectState]] = deque(maxlen=_KEPT)
        self.forget()

    def forget(self) -> None:
        """Forget the object because time was reset."""
        self._sightings.clear()
        self._received, self._off_since = -math.inf, math.inf
        self._tracker.reset()
        self._velocity.reset()

    def overdue(self, now: float) -> bool:
        """Return whether no message arrived in half the timeout before `now`, odometry's newest stamp."""
        return now - self._received > self.timeout / 2.0 - _ROUNDING

    def add(
        self,
        time: float,
        sighting: ObjectState,
        now: float | None,
        pace: float = 1.0,
        real: float = 0.0,
    ) -> str | None:
        """Process a sighting with the stamp `time` in s, which may be old; return the warning of its check.

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
                    f"{self._name}.header.stamp: expected about odometry's {now:.2f} s, got {time:.2f} s, "
                    f"{error}: another clock, odometry has ceased, or this machine is too slow"
                )
            self._received = now
        checked, warning = self._velocity.check(time, sighting)
        self._sightings.append((time, self._tracker.update(time, checked)))
        return warning

    def at(self, time: float) -> ObjectState | None:
        """Return the newest sighting not after odometry's `time`, extrapolated to it; None if there is none.

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
