"""Checks of reported velocities against positions: of objects, and of the robot."""

from __future__ import annotations

import math
from collections import deque

from ator_ros.world.state import ObjectState, RobotState

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
_ROUNDING = 1e-6
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
_MOST_OFF = 0.05
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
        if max(sizes) <= _MOST_OFF:
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
