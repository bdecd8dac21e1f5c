"""The velocity of a robot: derived from its poses, or reported and compared with them."""

from __future__ import annotations

import dataclasses
import math
from collections import deque

import numpy as np

from ator_ros.geometry import FloatArray, Pose
from ator_ros.world.state import Command, RobotState

_SPAN = 0.3  # s between two poses above which the robot counts as at rest
_KEPT_POSES = 64
# s; least time between poses from which a velocity is derived, one tick at 20 Hz
_ROBOT_SPAN = 0.04
_ROUNDING = 1e-6
# times a robot's limits, above which its pose has jumped, or its twist has another unit
BEYOND_LIMITS = 1.5
"""Ratio of the fastest plausible motion of a robot to its described limits."""


class RobotVelocity:
    """The velocity of a robot along the arc between two poses.

    `most_v` and `most_w` are the robot's limits in m/s and rad/s. If the pose jumps, as when a
    localization corrects it, the velocity does not change. The lateral velocity is 0 unless the
    robot moves `sideways`.
    """

    def __init__(self, most_v: float, most_w: float, *, sideways: bool = False) -> None:
        self._most_v = BEYOND_LIMITS * most_v
        self._most_w = BEYOND_LIMITS * most_w
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=_KEPT_POSES)
        self._sideways = sideways
        self._velocity = Command()
        self._jump: FloatArray | None = None  # the last motion, if it was a jump

    def state(self, time: float, pose: Pose) -> RobotState:
        """Process a pose at `time` (s); return it with its velocity: the mean of 0.04 s.

        After a gap of more than 0.3 s, or a reset of time, the robot counts as at rest.
        """
        if self._poses and not 0.0 <= time - self._poses[-1][0] <= _SPAN:
            self._poses.clear()
            self._velocity = Command()
            self._jump = None
        if not self._poses or time > self._poses[-1][0]:
            self._poses.append((time, pose))
        while len(self._poses) > 1 and time - self._poses[1][0] > _ROBOT_SPAN - _ROUNDING:
            self._poses.popleft()
        first, before = self._poses[0]
        if time - first > _ROBOT_SPAN - _ROUNDING:
            self._update(before.relative(pose), time - first, (time, pose))
        moving = self._velocity
        return RobotState(pose, moving.vx, moving.w, vy=moving.vy)

    def _update(
        self,
        moved: Pose,
        elapsed: float,
        newest: tuple[float, Pose],
    ) -> None:
        """Use the velocity of a motion, unless it is a jump.

        After two jumps in a row the second is used if it continues the first. Jumps to and fro are
        those of two senders.
        """
        length, sideways = _arc(moved)
        v = length / elapsed
        w = moved.yaw / elapsed
        jumps = max(abs(v), abs(sideways) / elapsed) > self._most_v or abs(w) > self._most_w
        jump = np.array([moved.x, moved.y, moved.yaw]) / elapsed if jumps else None
        before = self._jump
        self._jump = jump
        if jump is not None and (before is None or not _continues(before, jump)):
            self._poses.clear()
            self._poses.append(newest)
        else:
            self._velocity = Command(v, w, vy=sideways / elapsed if self._sideways else 0.0)


def _continues(before: FloatArray, jump: FloatArray) -> bool:
    """Return whether two motions (m/s, rad/s) are about the same."""
    return bool(np.linalg.norm(jump - before) <= 0.5 * np.linalg.norm(before))


def _arc(moved: Pose) -> tuple[float, float]:
    """Return the length in m of the arc to a pose, and how far the pose lies beside it in m."""
    half = moved.yaw / 2.0
    along = moved.x * math.cos(half) + moved.y * math.sin(half)
    sideways = moved.y * math.cos(half) - moved.x * math.sin(half)
    return along / (math.sin(half) / half if half else 1.0), sideways


_WINDOW = 0.5  # s over which the motion of a robot's poses is compared with that of its twist
_LONGEST_STEP = 0.3  # s between two messages above which their twists do not determine the motion
_LEAST_MOTION = 0.03  # m or rad in one window up to which a robot counts as at rest
_MOST_OFF = 0.015  # m or rad in one window; difference due to filters, slip and late stamps
TWIST_TOLERANCE = 0.3
"""Share of the greater motion by which pose and twist may differ: filters, slip and late stamps."""
# motion that no ground robot makes: its pose was corrected, or a simulation placed it
_FASTEST_V = 20.0  # m/s
_FASTEST_W = 50.0  # rad/s
# ratios of a twist in another unit to that in m/s or rad/s, for driving and turning
_UNITS = (
    {"mm/s": 1000.0, "cm/s": 100.0, "km/h": 3.6},
    {"degrees/s": math.degrees(1.0), "mrad/s": 1000.0},
)
_SAME_UNIT = 0.2  # share by which these ratios may differ
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
    agree for half a second. Velocities above `fastest` (m/s, rad/s) are never used.

    `unit` is the unit that the twist seems to have, if that is the reason; else empty.
    """

    def __init__(self, fastest: tuple[float, float] = (_FASTEST_V, _FASTEST_W)) -> None:
        self._fastest = fastest
        self.unit = ""
        self._last: tuple[float, RobotState] | None = None
        self._reported = False
        self._windows = [0, 0]  # of driving and of turning
        self._contradictions = _Contradictions(), _Contradictions()
        self._restart()

    def _restart(self) -> None:
        # rows: by poses, by twist; columns: m, rad
        self._elapsed = 0.0
        self._motion = np.zeros((2, 2))
        self._step = _MotionStep(0.0, np.zeros((2, 2)))
        self._steps: deque[_MotionStep] = deque(maxlen=_MEDIAN_OF)
        for contradictions in self._contradictions:
            contradictions.restart()

    def check(self, time: float, robot: RobotState) -> tuple[RobotState, str]:
        """Process odometry of `time` (s); return the state to use, and a remark.

        The remark says once how pose and twist contradict each other, else it is empty.
        """
        last = self._last
        self._last = (time, robot)
        if last is None:
            return self._plausible(robot), ""
        elapsed = time - last[0]
        before = last[1]
        if not 0.0 <= elapsed <= _LONGEST_STEP:
            self._restart()
            return self._plausible(robot), ""
        if elapsed == 0.0:
            return self._plausible(robot), ""
        moved = before.pose.relative(robot.pose)
        least = max(math.hypot(moved.x, moved.y) / _FASTEST_V, abs(moved.yaw) / _FASTEST_W)
        if elapsed < least:  # it was placed there
            self._restart()
            return self._plausible(robot), ""
        reported = 0.5 * elapsed * np.array([before.vx + robot.vx, before.w + robot.w])
        motion = np.array([(_arc(moved)[0], moved.yaw), reported])
        self._add_step(elapsed, motion)
        self._elapsed += elapsed
        self._motion = self._motion + motion
        remark = self._judge() if self._elapsed >= _WINDOW - _ROUNDING else ""
        vx, w = (self._velocity(axis, value) for axis, value in enumerate((robot.vx, robot.w)))
        return dataclasses.replace(robot, vx=vx, w=w), remark

    def _plausible(self, robot: RobotState) -> RobotState:
        """Return a state whose velocities are not impossible."""
        vx, w = (
            0.0 if abs(value) > most else value
            for value, most in zip((robot.vx, robot.w), self._fastest, strict=True)
        )
        return dataclasses.replace(robot, vx=vx, w=w)

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
        elapsed = self._elapsed
        motion = self._motion
        self._elapsed = 0.0
        self._motion = np.zeros((2, 2))
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
        ratio = abs(by_twist / by_pose) if by_pose else math.inf
        for other, factor in _UNITS[axis].items():
            if abs(ratio / factor - 1.0) <= _SAME_UNIT:
                self.unit = other
        advice = f"; it looks like {self.unit}: publish {unit}" if self.unit else ""
        return (
            f"pose and {name} contradict each other: "
            f"expected about {by_pose:.2f} {unit} from the poses, "
            f"got {by_twist:.2f} {unit}{advice}"
        )

    def replaces(self, axis: int) -> bool:
        """Return whether velocities of driving (0) or turning (1) are derived from the poses."""
        reported = 0.0 if self._last is None else (self._last[1].vx, self._last[1].w)[axis]
        if abs(reported) > self._fastest[axis]:
            return True
        return self._contradictions[axis].confirmed or self._windows[axis] == _CONFIRMED

    def _velocity(self, axis: int, reported: float) -> float:
        """Return the velocity of driving (0) or turning (1) in m/s or rad/s."""
        if self.replaces(axis):
            speeds = [step.motion[0, axis] / step.elapsed for step in self._steps]
            unknown = 0.0 if abs(reported) > self._fastest[axis] else reported
            return float(np.median(speeds)) if speeds else unknown
        return -reported if reported and self._has_wrong_sign(axis) else reported

    def _has_wrong_sign(self, axis: int) -> bool:
        """Return whether the robot has moved as far as reported, but in the other direction."""
        span = 0.0
        moved = 0.0
        reported = 0.0
        for step in reversed(self._steps):
            by_pose, by_twist = step.motion[:, axis]
            if by_pose * by_twist >= 0.0:
                return False
            span = span + step.elapsed
            moved = moved + by_pose
            reported = reported + by_twist
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
