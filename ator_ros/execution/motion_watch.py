"""Monitoring of the base by odometry: does it follow its commands? Without ROS.

Both clocks are passed in.
"""

from __future__ import annotations

import bisect
import enum
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.bases.base import Axis
from ator_ros.bases.description import Robot
from ator_ros.bases.foresight import Foresight
from ator_ros.execution.odometry_point import OdometryPoint
from ator_ros.geometry import clip, wrap_angle
from ator_ros.world.state import STOP, Command, RobotState

_DELAY = 0.1  # s by which a base may be later than `latency`: two messages at 20 Hz
# s by which a base may be earlier than `latency`: 0.1 s, and one message at 20 Hz
_EARLY = 0.15
_WINDOW = 0.3  # s of commands that are compared, besides twice the lag of the motors
_PERSISTS = 0.15  # s after which a fault is reported: three messages at 20 Hz, longer than noise
_LEAST_REAL_TIME = 0.1  # s in which commands reach the base, however fast simulated time passes
_LONG_GAP = 0.15  # s between two messages above which a base with a watchdog may have stopped
_SMOOTHING = 0.1  # s over which measured velocities are averaged
_QUARTER = 0.25  # least share of the expected motion of a base that follows
_COASTING = 0.25  # s for which a base may keep a speed beyond its commands
_BEYOND = 1.5  # multiple of the tolerance beyond its commands that is a fault
_LOSES = 0.3  # s for which a base that follows does not lose speed below its commands
_STEP = 0.025  # s; step of the prediction
_GAIN = 1.25  # greatest share of the commanded speed of a base that is faster than commanded
_FASTER = 1.05  # share of the commanded speed from which the base is said to be faster

# Odometry is frozen; longer than total slip of 0.3 s, and at 20 Hz noticed within 0.5 s.
_FROZEN = 0.35  # s for which the pose is the same although the robot is commanded to move
_REPEATED = 0.3  # s; also if the velocity repeats exactly
_SAME = 0.1  # share of the reported motion below which a pose is the same

_CONTRADICTS = 0.15  # s over which pose and twist are compared when there is a fault

# s by which a base may be later than `latency` if that explains a fault, and their step
_LATEST, _LATE_STEP = 0.6, 0.05
_COMPARED = 0.8  # s of motion for that

# A speed that is the opposite of the commands: see `AxisWatch._is_opposite`.
_OPPOSITE = 0.3  # s of motion that are compared
_LATE = (0.0, 0.05, 0.1)  # s by which the base may be late in that comparison

# A speed that is constant whatever is commanded: see `AxisWatch._is_constant`.
_CONSTANT = 0.25  # s of motion that are compared, besides the lag of the motors
_FEWEST = 4  # least number of messages in that time, and to determine the share
_VARIES = 0.5  # greatest variation as a multiple of the tolerance
# share of the described limit above which the base may be at a lower one of its own
_NEAR_LIMIT = 0.75
_CONSTANT_PERSISTS = 0.06  # s after which the fault is reported, in two messages at least
_ROUNDING = 1e-6
_PLACES = {"m/s": "position", "rad/s": "heading"}
_VERBS = {"move": "drives", "turn": "turns"}  # of a base that is slower than commanded
_LEAST_TOLERANCE = {"m/s": 0.04, "rad/s": 0.1}  # noise and dead band of usual bases


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Limits and thresholds of one axis, in m and m/s or in rad and rad/s.

    The tolerance is 4 % of the limit, at least `_LEAST_TOLERANCE`, at most 40 %.
    """

    limit: float  # described greatest speed
    rate: float  # described greatest change of speed per s
    lag: float  # s; time constant of the motors
    stop: float  # described change of speed per s when commanded to stand
    tolerance: float  # difference of speeds that is ignored
    window: float  # s over which the measured change of speed is compared with the predicted one

    @classmethod
    def of(cls, robot: Robot, axis: Axis) -> Thresholds:
        """Return the thresholds of an axis of a robot."""
        tolerance = min(max(0.04 * axis.limit, _LEAST_TOLERANCE[axis.unit]), 0.4 * axis.limit)
        window = _WINDOW + 2.0 * robot.lag
        return cls(axis.limit, axis.rate, robot.lag, axis.stop, tolerance, window)


class Fault(enum.Enum):
    """Kind of deviation of the base from its commands; the value is its message."""

    STILL = (
        "does not {move} as commanded: {shown}: blocked wheels, an obstacle, motors off, or odometry that is "
        "frozen or shows too little"
    )
    REVERSED = "{move}s in the wrong direction: {shown}: motors or odometry with the wrong sign"
    EXCESS = "{move}s although it was not commanded to: {shown}"
    EARLY = (
        "reacts earlier than `latency` {latency:g} s: lower it (`calibrate` measures it): {shown}"
    )
    LATE = "{late}: {shown}"
    CONSTANT = (
        "does not follow its commands: {shown}, constantly: another program may steer it, or it cannot reach "
        "the described {limit:.2f} {unit} (see calibrate)"
    )


_NEVER_BACKWARD = "; if the base never drives backward, set limits.v_back: 0 in its description"


class Debounce:
    """Determines whether a condition persists, by the stamps and in real time."""

    def __init__(self) -> None:
        self._seconds, self._since = 0.0, math.inf

    def update(self, holds: bool, gap: Gap, needed: float = _PERSISTS) -> bool:
        """Add the gap before a message if the condition `holds`, else reset.

        Return whether it persists.
        """
        if not holds:
            self._seconds, self._since = 0.0, math.inf
            return False
        self._since = min(self._since, gap.began)
        # One message says little about a gap above 0.1 s, unless the gap is very long.
        self._seconds += (
            gap.elapsed if gap.elapsed >= _WINDOW - _ROUNDING else min(gap.elapsed, 0.1)
        )
        in_real_time = gap.ended - self._since >= _LEAST_REAL_TIME - _ROUNDING
        return self._seconds >= needed - _ROUNDING and in_real_time


@dataclass(frozen=True, slots=True)
class Gap:
    """The time between two messages."""

    elapsed: float  # s, by their stamps
    began: float  # s; real times of the messages
    ended: float


class AxisWatch:
    """Compares one velocity of the base with the commands.

    The speed at the start of a window is predicted forward under the commands sent since, for a
    base that may be late. The base must have made at least a quarter of the predicted change. A
    base that reaches a quarter of the commanded speeds or more is slow, which is no fault, unless
    it keeps a constant speed that is not its share of the commands: plans that start at the
    measured speed conceal such a base. A base may also be up to a quarter faster than commanded if
    it was so before the commands changed.

    A base may be up to `early` s earlier than its latency: commands that were sent but should act
    only then may explain its motion, too.
    """

    def __init__(self, thresholds: Thresholds, early: float = 0.0) -> None:
        self.thresholds, self._early = thresholds, early
        self._measured: deque[tuple[float, float]] = deque()
        self._smooth: deque[tuple[float, float]] = deque()
        self._compared: deque[tuple[float, float, list[float]]] = deque()
        self._fault = Debounce()
        self._constant = False
        self._slow_for, self._share = 0.0, 1.0
        self._lost, self._eased, self._lost_for, self._commanded = 0.0, 0.0, 0.0, 0.0
        self._shares: deque[tuple[float, float]] = deque(maxlen=_FEWEST)
        self._last_response = -math.inf, 0.0

    @property
    def share(self) -> float:
        """The speed as a share of the commanded one if it has differed for more than a second, else 1."""
        return self._share if self._slow_for >= 1.0 else 1.0

    @property
    def speed(self) -> float:
        """The last speed, averaged."""
        return self._smooth[-1][1]

    def update(self, time: float, speed: float, commands: Commands, gap: Gap) -> Fault | None:
        """Process the speed at `time` (s); return the fault that persists."""
        self._observe_response(time, speed, commands)
        self._measured.append((time, speed))
        while self._measured[0][0] < time - _SMOOTHING + _ROUNDING:
            self._measured.popleft()
        speed = sum(value for _, value in self._measured) / len(self._measured)
        self._smooth.append((time, speed))
        while (
            len(self._smooth) > 1
            and self._smooth[1][0] <= time - self.thresholds.window + _ROUNDING
        ):
            self._smooth.popleft()
        if len(self._smooth) == 1:
            return None
        limit = self.thresholds.limit
        latest = time + self._early
        recent = [clip(command, limit) for command in commands.between(time - _DELAY, latest)]
        self._compare(time, commands)
        fault = self._fault_now(time, speed, recent, commands, gap)
        was_constant, self._constant = self._constant, fault is Fault.CONSTANT
        needed = _CONSTANT_PERSISTS if was_constant and self._constant else _PERSISTS
        persists = self._fault.update(fault is not None, gap, needed)
        stood = 0.0 in commands.between(time - _DELAY - 2.0 * self.thresholds.lag, latest)
        loses = not stood and self._loses(speed, min(recent), max(recent), gap)
        self._observe_share(speed, recent, gap.elapsed)
        if self._is_opposite():
            return Fault.REVERSED
        return fault if persists else Fault.STILL if loses else None

    def _fault_now(
        self, time: float, speed: float, recent: Sequence[float], commands: Commands, gap: Gap
    ) -> Fault | None:
        tolerance = self.thresholds.tolerance
        since, before = self._smooth[0]
        fast = [0.0, before]
        for early in {0.0, self._early}:
            predicted = self._fast(since, before, time, commands, early)
            fast += predicted[-round(_COASTING / _STEP) :]
        gain = self._gain_at(since, before, commands)
        low, high = gain * min(fast), gain * max(fast)
        if not low - _BEYOND * tolerance <= self._measured[-1][1] <= high + _BEYOND * tolerance:
            return Fault.EXCESS
        # At the start of the window the base may just have started to move.
        fastest = max(self._smooth, key=lambda each: abs(each[1]))
        share = min(
            0.99, max(self._share_at(*each, commands) for each in (self._smooth[0], fastest))
        )
        slow, part = (self._slow(since, before, time, commands, each) for each in (1.0, share))
        # The least speed that is expected now, in the direction of the commands.
        least = max(0.0, min(part, share * min(recent))) + min(0.0, max(part, share * max(recent)))
        sign = math.copysign(1.0, least)
        ahead, gained = abs(least) - sign * before, sign * (speed - before)
        approached = ahead > 0.0 and gained >= _QUARTER * ahead
        if abs(least) >= tolerance and _is_below_quarter(speed, least) and not approached:
            return Fault.STILL
        if gap.elapsed > _LONG_GAP:
            return None  # a base with a watchdog has stopped and started again
        sign = math.copysign(1.0, before)
        most = max(sign * slow, *(gain * sign * command for command in recent))
        had, has = sign * before, sign * speed
        if had - most >= tolerance and had - has < _QUARTER * (had - most):
            return Fault.EXCESS
        spans = [_CONSTANT + self.thresholds.lag]
        if all(_is_below_quarter(speed, command) for command in recent):
            spans.append(self.thresholds.window)  # in which the commands vary more
        if any(self._is_constant(time, seconds, recent, commands) for seconds in spans):
            return Fault.CONSTANT
        return None

    def _is_constant(
        self, time: float, seconds: float, recent: Sequence[float], commands: Commands
    ) -> bool:
        """Return whether the speed is constant and differs from the commands, unless the base is slow.

        A slow base reaches a share of the commands, which was measured while its speed changed, or
        a limit of its own not far below the described one.
        """
        axis = self.thresholds
        since = min(time - seconds, self._smooth[-min(_FEWEST, len(self._smooth))][0])
        recently = [(then, value) for then, value in self._smooth if then >= since - _ROUNDING]
        speeds = [value for _, value in recently]
        if len(speeds) < _FEWEST or max(speeds) - min(speeds) > _VARIES * axis.tolerance:
            return False
        speed = speeds[-1]
        # The last commands cannot be the cause of a speed that was constant before.
        latest = time - _DELAY + self._early
        sent = [clip(command, axis.limit) for command in commands.between(since, latest)]
        gain = self._gain_at(*recently[0], commands)
        low = min(*sent, *(gain * command for command in sent))
        high = max(*sent, *(gain * command for command in sent))
        if low - axis.tolerance < speed < high + axis.tolerance:
            return False
        slower = all(command * speed >= speed * speed for command in sent)
        if slower and abs(speed) >= _NEAR_LIMIT * axis.limit:
            return False
        known = [
            sum(acting) / len(acting)
            for then, _ in recently
            if then <= time - _DELAY - axis.lag
            for acting in [commands.between(then - _SMOOTHING, then)]
        ]
        if known and max(known) - min(known) >= 2.0 * axis.tolerance:
            return True
        possible = [
            share * command for pair in self._shares for share in pair for command in recent
        ]
        return not (
            possible and min(possible) - axis.tolerance <= speed <= max(possible) + axis.tolerance
        )

    def _compare(self, time: float, commands: Commands) -> None:
        """Store the last speed and the commands to which it may be the response."""
        limit = self.thresholds.limit
        sent = [clip(commands.between(time - late, time - late)[0], limit) for late in _LATE]
        self._compared.append((time, self._measured[-1][1], sent))
        while self._compared[0][0] < time - _OPPOSITE - _ROUNDING:
            self._compared.popleft()

    def _is_opposite(self) -> bool:
        """Return whether the base has the opposite of the commanded speeds.

        New plans start at the measured speed, so such a base is commanded to and fro: no single
        speed differs from its commands for long.
        """
        if len(self._compared) < _FEWEST or self._span < 0.8 * _OPPOSITE:
            return False
        speeds = np.array([speed for _, speed, _ in self._compared])
        changes = speeds - speeds.mean()
        tolerance = self.thresholds.tolerance
        if min(np.abs(speeds).mean(), 2.0 * np.abs(changes).mean()) < tolerance:
            return False
        for commands in np.array([sent for _, _, sent in self._compared]).T:
            # The speeds are opposite, and so are their changes: a base that brakes late is not.
            sums = (
                np.abs(speeds + commands).sum(),
                np.abs(changes + commands - commands.mean()).sum(),
            )
            if sums[0] > 0.5 * np.abs(speeds).sum() or sums[1] > 0.5 * np.abs(changes).sum():
                continue
            return True
        return False

    @property
    def _span(self) -> float:
        """The time in s between the first and the last speed that are compared."""
        return self._compared[-1][0] - self._compared[0][0]

    def _gain_at(self, time: float, speed: float, commands: Commands) -> float:
        """Return the speed as a share of the least of the commands at `time`, 1 to 1.25."""
        acting = commands.between(time - _DELAY - 2.0 * self.thresholds.lag, time)
        command = min(acting, key=lambda each: each * speed)
        if command * speed <= 0.0:
            return 1.0
        return min(_GAIN, max(1.0, speed / command))

    def _share_at(self, time: float, speed: float, commands: Commands) -> float:
        """Return the speed as a share of the commands at `time`, at least a quarter.

        1 without a command.
        """
        command = max(commands.between(time - _DELAY - 2.0 * self.thresholds.lag, time), key=abs)
        if abs(command) < self.thresholds.tolerance or speed * command <= 0.0:
            return 1.0
        return min(1.0, max(_QUARTER, speed / command))

    def _slow(
        self, since: float, speed: float, time: float, commands: Commands, share: float
    ) -> float:
        """Return the speed at `time` of a base that had `speed` at `since`, is late and lags.

        To reach a lower share it brakes as on a command to stand.
        """
        axis, count, dt = self.thresholds, *_steps(time - since)
        sent = [
            share * clip(speed if c is None else c, axis.limit)
            for c in commands.sampled(since - _DELAY, dt, count)
        ]
        setpoint = speed
        for target in sent:
            rate = axis.stop if target == 0.0 and share < 1.0 else axis.rate
            setpoint += clip(target - setpoint, rate * dt)
            speed += (setpoint - speed) * min(1.0, dt / max(axis.lag, _STEP))
        return speed

    def _fast(
        self, since: float, speed: float, time: float, commands: Commands, early: float
    ) -> list[float]:
        """Return the speeds until `time` of a base that changes its speed twice as fast as described."""
        speeds, (count, dt) = [], _steps(time - since)
        for command in commands.sampled(since + early + dt, dt, count):
            speed += clip(
                (speed if command is None else command) - speed, 2.0 * self.thresholds.rate * dt
            )
            speeds.append(speed)
        return speeds

    def _loses(self, speed: float, low: float, high: float, gap: Gap) -> bool:
        """Return whether the axis continues to lose speed below every recent command.

        A base whose speed drops to a part, and stays there, is slow, but follows.
        """
        (_, before), sign = self._smooth[-2], math.copysign(1.0, speed)
        commanded = sign * (low if sign > 0.0 else high)
        lost = sign * (before - speed)
        falls = lost >= _QUARTER * self.thresholds.rate * gap.elapsed
        below = sign * speed < commanded - 0.25 * self.thresholds.tolerance
        eased, self._commanded = max(0.0, sign * self._commanded - commanded), sign * commanded
        if not (falls and below) or gap.elapsed > _LONG_GAP:
            self._lost, self._eased, self._lost_for = 0.0, 0.0, 0.0
            return False
        # more is a drop to a part of the speed
        lost = min(lost, 1.5 * self.thresholds.rate * gap.elapsed)
        self._lost, self._eased = self._lost + lost, self._eased + eased
        self._lost_for += gap.elapsed
        tolerance = self.thresholds.tolerance
        enough = self._lost >= max(2.0 * tolerance, self._eased + 0.5 * tolerance)
        return enough and self._lost_for >= _LOSES - _ROUNDING

    def _observe_response(self, time: float, speed: float, commands: Commands) -> None:
        """Record which shares of the commands the base reaches while its speed changes, late or in time."""
        axis, (then, before) = self.thresholds, self._last_response
        if time - then < 0.5 * _SMOOTHING - _ROUNDING:
            return
        self._last_response = time, speed
        if abs(speed - before) < 0.05 * axis.tolerance:
            return
        if abs(speed - before) > 1.5 * axis.rate * (time - then) + axis.tolerance:
            self._shares.clear()  # after a jump, earlier shares do not apply
        sent = [clip(commands.between(late, late)[0], axis.limit) for late in (time, time - _DELAY)]
        if (
            min(abs(command) for command in sent) >= 2.0 * axis.tolerance
            and sent[0] * sent[1] > 0.0
        ):
            self._shares.append((speed / sent[0], speed / sent[1]))

    def _observe_share(self, speed: float, recent: Sequence[float], elapsed: float) -> None:
        """Record the share of the commanded speed that the base reaches."""
        command = min(recent, key=abs)
        if abs(command) < 0.2 * self.thresholds.limit:
            return
        share = speed / command
        if share > 1.0:
            share = max(1.0, speed / max(recent, key=abs))
        if 0.0 < share < 0.75 or _FASTER <= share <= _GAIN:
            passed = min(elapsed, 0.1)
            self._share += (share - self._share) * (passed / (self._slow_for + passed))
            self._slow_for = min(self._slow_for + passed, 2.0)
        else:
            self._slow_for = max(0.0, self._slow_for - min(elapsed, 0.1))


class Commands:
    """The commands of one axis with the times in s from which they act."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._sent: list[float] = []

    def add(self, acts: float, command: float) -> None:
        """Add a command that acts from `acts` (s) on and replaces later ones."""
        earlier = bisect.bisect_left(self._times, acts)
        self._times[earlier:], self._sent[earlier:] = [acts], [command]

    def delay_last(self, seconds: float) -> None:
        """Let the last command act later."""
        if self._times:
            self._times[-1] += seconds

    def forget(self, time: float) -> None:
        """Forget the commands that no longer act at `time` (s)."""
        over = max(0, bisect.bisect_right(self._times, time) - 1)
        del self._times[:over], self._sent[:over]

    def between(self, since: float, until: float) -> list[float]:
        """Return the commands that acted between two times in s; 0 before the first one."""
        begin, end = (bisect.bisect_right(self._times, time + _ROUNDING) for time in (since, until))
        return [self._sent[begin - 1] if begin else 0.0, *self._sent[begin:end]]

    def sampled(self, since: float, dt: float, count: int) -> list[float | None]:
        """Return the commands that act at `count` times in s from `since` on.

        None before the first one.
        """
        found = (
            bisect.bisect_right(self._times, since + step * dt + _ROUNDING) for step in range(count)
        )
        return [self._sent[index - 1] if index else None for index in found]


class MotionWatch:
    """Compares odometry with the commands that were sent, separately for each axis of the base.

    Faults are those of `Fault`, and a pose that is constant while the velocity is not. With
    odometry below 6.7 Hz (at the default `odom_timeout`) the robot is commanded to stand between
    two messages. Then some frozen odometry is not detected, as it is like that of a late base, and
    the robot moves by centimeters.

    `latency` is the time in s from the stamp of a state until the command for it moves the base;
    `foresight` predicts states under the same commands.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self._robot, self._latency = robot, latency
        self._axes = robot.axes
        self._thresholds = [Thresholds.of(robot, axis) for axis in robot.axes]
        self.foresight = Foresight(robot, latency)
        self._point = OdometryPoint(robot.reach)
        self._forget()

    def reset(self) -> None:
        """Forget all states and commands because time was reset."""
        self.foresight.reset()
        self._forget()

    def begin(self, latency: float, *, preempts: bool) -> None:
        """Start monitoring for a new goal, whose latency may differ.

        Motion before the goal is ignored, as other programs may have moved the base. A goal that
        `preempts` another continues with its latency and commands, which may still act.
        """
        if preempts:
            return
        if latency != self._latency:
            self._latency, self.foresight = latency, Foresight(self._robot, latency)
        self._forget()

    def _forget(self) -> None:
        early = min(self._latency, _EARLY)
        self._watches = [AxisWatch(each, early) for each in self._thresholds]
        # These raise no fault where a shorter latency explains the motion.
        self._without_latency = [AxisWatch(each, self._latency) for each in self._thresholds]
        self._commands = [Commands() for _ in self._axes]
        self._last = STOP
        self._faulty, self._is_driving_faulty, self._late = False, False, False
        self._states: deque[tuple[float, RobotState]] = deque()
        self._received, self._answered = -math.inf, math.inf

    @property
    def remark(self) -> str:
        """A sentence on a slow or fast base, and on odometry of another point than the axle; else empty."""
        parts = [
            f"{_VERBS[axis.verb]} at about {_percent(watch.share)} % of the commanded speed"
            for axis, watch in zip(self._axes, self._watches, strict=True)
            if watch.share != 1.0
        ]
        slow = f"the base {' and '.join(parts)}" if parts else ""
        return "; ".join(filter(None, (slow, self._point.remark)))

    @property
    def cause(self) -> str:
        """The cause of a fault that the motion before and after it shows; else empty."""
        if self._late and not self._point.remark:
            return f"the base {self._lateness}"
        return self._point.suspicion() if self._is_driving_faulty else self._point.remark

    @property
    def _lateness(self) -> str:
        return (
            f"reacts later than `latency` {self._latency:g} s: raise it (`calibrate` measures it)"
        )

    def sent(self, time: float, command: Command | None, now: float = -math.inf) -> None:
        """Record a command that was sent in response to a state of `time` (s), at `now` in real s.

        None: another program moves the base, so its motion is not compared with our commands.
        """
        self.foresight.sent(time, command)
        if command is None:
            self._forget()
            return
        self._answered, self._last = min(self._answered, now), command
        for commands, value in zip(self._commands, self._parts(command), strict=True):
            commands.add(time + self._latency, value)

    def _parts(self, velocity: Command | RobotState) -> list[float]:
        """Return the velocity of each axis."""
        return [getattr(velocity, axis.name) for axis in self._axes]

    def fault(self, time: float, robot: RobotState, now: float) -> str | None:
        """Process odometry of `time` (s), received at `now` (real s).

        Return the fault in words, or None.
        """
        (commanded,) = self._commands[0].between(time, time)
        self._point.update(time, robot.pose, commanded)
        last = self._states[-1] if self._states else (time, robot)
        if time < last[0]:
            self._forget()
        gap = Gap(time - last[0], self._received, now)
        self._delay_late_answer(gap)
        self._received, self._answered = now, math.inf
        self._states.append((time, robot))
        while len(self._states) > 1 and self._states[1][0] <= time - 1.0:
            self._states.popleft()
        shown = self._shown(last[1], robot, gap)
        faults = [
            watch.update(time, speed, commands, gap)
            for watch, speed, commands in zip(self._watches, shown, self._commands, strict=True)
        ]
        if self._latency > _EARLY:
            for number, watch in enumerate(self._without_latency):
                tolerant = watch.update(time, shown[number], self._commands[number], gap)
                if tolerant is None and faults[number] is not None:
                    faults[number] = Fault.EARLY
        if any(faults) or self._faulty:
            self._faulty = True
            self._late |= any(self._is_late(time, axis) for axis in range(len(self._axes)))
            late = [None if fault is None else Fault.LATE for fault in faults]
            faults = late if self._late and Fault.EARLY not in faults else faults
        for commands in self._commands:
            commands.forget(time - max(2.0 * self._thresholds[0].window, _COMPARED + _LATEST))
        # Where the poses contradict the twist they decide: see `TwistCheck`.
        trusted = [
            None if fault is not None and self._contradicts(time, number) else fault
            for number, fault in enumerate(faults)
        ]
        self._is_driving_faulty |= trusted[0] is not None
        return self._frozen(time, robot) or self._message(robot, trusted)

    def _delay_late_answer(self, gap: Gap) -> None:
        """Let a command that was sent late in a long gap act later.

        In a short gap it acts from the start: a simulation may have waited for it.
        """
        late = self._answered - gap.began
        if gap.elapsed > _LONG_GAP and 0.0 < late < gap.ended - gap.began:
            for commands in self._commands:
                commands.delay_last(late / (gap.ended - gap.began) * gap.elapsed)

    def _shown(self, before: RobotState, robot: RobotState, gap: Gap) -> list[float]:
        """Return the velocities by odometry.

        In a long gap the base may have moved and then stopped by itself, so its mean velocity
        counts, too.
        """
        if gap.elapsed <= _LONG_GAP:
            return self._parts(robot)
        seconds = min(gap.elapsed, self._thresholds[0].window)
        return [
            speed if abs(speed) >= axis.tolerance else moved / seconds
            for speed, axis, moved in zip(
                self._parts(robot), self._thresholds, self._moved(before, robot), strict=True
            )
        ]

    def _frozen(self, time: float, robot: RobotState) -> str | None:
        """Return the fault if the robot is commanded to move and reports it, but its pose is constant."""
        repeated = all(state == robot for _, state in self._since(time - _REPEATED))
        recent = self._since(time - (_REPEATED if repeated else _FROZEN))
        if not recent:
            return None
        began, first = recent[0]
        states = [state for _, state in recent]
        elapsed = time - began
        if elapsed > _LONG_GAP * len(states):
            return None  # messages are missing, between which the robot may have moved to and fro
        for number, axis in enumerate(self._axes):
            tolerance = self._thresholds[number].tolerance
            reported = self._parts(robot)[number]
            sign = math.copysign(1.0, reported)
            least = min(sign * self._parts(state)[number] for state in states)
            commanded = min(sign * sent for sent in self._commands[number].between(began, time))
            moved = max(abs(self._moved(first, state)[number]) for state in states)
            moves = min(least, commanded) >= tolerance
            if moves and moved < _SAME * least * elapsed:
                return (
                    f"odometry is frozen: it reports {self._words(robot)}, "
                    f"but its {_PLACES[axis.unit]} has been constant for {elapsed:.2f} s "
                    f"(velocity {reported:.2f} {axis.unit})"
                )
        return None

    def _contradicts(self, time: float, axis: int) -> bool:
        """Return whether the last poses move in contradiction to the velocities of an axis."""
        recent = self._since(time - _CONTRADICTS)
        if not recent:
            return False
        (began, first), (_, last) = recent[0], recent[-1]
        tolerance = self._thresholds[axis].tolerance
        moved = self._moved(first, last)[axis] / (time - began)
        # The last velocities: one that jumped may have done so at any time between two messages.
        speeds = [self._parts(state)[axis] for _, state in recent[1:]]
        reported = min(max(moved, min(speeds)), max(speeds))
        greatest = max(abs(moved), abs(reported))
        return abs(moved - reported) >= max(tolerance, 0.5 * greatest) and moved != 0.0

    def _is_late(self, time: float, axis: int) -> bool:
        """Return whether the base follows the commands of an axis, but later than `latency`."""
        recent = self._since(time - _COMPARED) or list(self._states)
        speeds = np.array([self._parts(state)[axis] for _, state in recent])
        tolerance = self._thresholds[axis].tolerance
        if np.ptp(speeds) < 2.0 * tolerance:
            return False  # a base that does not move does not react later

        def off(late: float) -> float:
            commands = self._commands[axis]
            sent = [commands.between(then - late, then - late)[0] for then, _ in recent]
            return float(np.abs(speeds - sent).mean())

        steps = round(_LATEST / _LATE_STEP)
        differences = [off(step * _LATE_STEP) for step in range(steps + 1)]
        punctual = round(_DELAY / _LATE_STEP) + 1
        least = min(differences[punctual:])
        most = min(0.5 * min(differences[:punctual]), 0.5 * float(np.abs(speeds).mean()), tolerance)
        return least < most

    def _since(self, time: float) -> list[tuple[float, RobotState]]:
        """Return the states from the last one at or before `time` (s) on; none if there is no such one."""
        before = [index for index, (then, _) in enumerate(self._states) if then <= time + _ROUNDING]
        return list(self._states)[before[-1] :] if before else []

    def _message(self, robot: RobotState, faults: Sequence[Fault | None]) -> str | None:
        """Return the fault of the first axis that has one, in words."""
        shown = f"commanded to {self._words(self._last)}, odometry shows {self._words(robot)}"
        for number, fault in enumerate(faults):
            if fault is not None:
                axis, watch = self._axes[number], self._watches[number]
                command = self._parts(self._last)[number]
                against = watch.speed * command <= -watch.thresholds.tolerance * abs(command)
                fault = Fault.REVERSED if fault is Fault.STILL and against and command else fault
                text = fault.value.format(
                    move=axis.verb,
                    shown=shown,
                    limit=axis.limit,
                    unit=axis.unit,
                    latency=self._latency,
                    late=self._lateness,
                )
                backward = fault is Fault.STILL and axis.name == "vx" and command < 0.0
                return f"the base {text}{_NEVER_BACKWARD if backward else ''}"
        return None

    def _words(self, velocity: Command | RobotState) -> str:
        """Return the velocity of each axis with its unit."""
        parts = zip(self._parts(velocity), self._axes, strict=True)
        return " and ".join(f"{speed:.2f} {axis.unit}" for speed, axis in parts)

    def _moved(self, before: RobotState, after: RobotState) -> list[float]:
        """Return how far a robot moved along each axis, in m and rad.

        A base that cannot move sideways has driven the whole distance.
        """
        moved = before.pose.relative(after.pose)
        distance = before.pose.distance(after.pose)
        ahead = moved.x if self._robot.moves_sideways else math.copysign(distance, moved.x)
        parts = {"vx": ahead, "vy": moved.y, "w": wrap_angle(after.pose.yaw - before.pose.yaw)}
        return [parts[axis.name] for axis in self._axes]


def _steps(seconds: float) -> tuple[int, float]:
    """Return the number of steps in which to predict, and their length in s."""
    count = math.ceil(seconds / _STEP - _ROUNDING)
    return count, seconds / count


def _percent(share: float) -> int:
    """Return a share in percent: in steps of ten below 1."""
    return round(100 * share) if share > 1.0 else 10 * round(10 * share)


def _is_below_quarter(speed: float, command: float) -> bool:
    """Return whether a speed is less than a quarter of the command, or in the other direction."""
    return speed * command < _QUARTER * command * command
