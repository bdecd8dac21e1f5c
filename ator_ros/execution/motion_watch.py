"""Monitoring of the base by odometry: does it follow its commands? Without ROS.

Both clocks are passed in.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.bases.foresight import Foresight
from ator_ros.bases.interface import Axis
from ator_ros.execution.followers import LATE, ROUNDING, STEP, Commands, Response
from ator_ros.execution.odometry_point import OdometryPoint
from ator_ros.geometry import FloatArray, wrap_angle
from ator_ros.world.state import STOP, Command, RobotState

# What a base that follows its commands may do:
_EARLY = 0.15  # s by which it may be earlier: 0.1 s, and one message at 20 Hz
# share of a command backward below which the base stands: a blocked one may creep, or be noisy
_STANDS = 0.15
_QUARTER = 0.25  # least share of the expected motion: a slow base is no fault
_GAIN = 1.25  # greatest share of the commanded speed: with larger wheels than described
_BEYOND = 1.5  # multiple of the tolerance by which it may be faster than all this: noise

_PERSISTS = 0.15  # s after which a fault is reported: three messages at 20 Hz, longer than noise
_LEAST_REAL_TIME = 0.1  # s in which commands reach the base, however fast simulated time passes
_SMOOTHING = 0.1  # s over which measured velocities are averaged: two messages at 20 Hz
_LONG_GAP = 0.15  # s between two messages above which a base with a watchdog may have stopped
_VERY_LONG_GAP = 0.3  # s; one message after such a gap counts in full
_DEPARTS = 0.3  # s for which a base may depart from its commands: longer than a delayed response
_CONSTANT = 0.25  # s, besides the lag, after which a speed responds to other commands
_CONSTANT_PERSISTS = 0.06  # s after which a constant speed is a fault: two messages
_FEWEST = 4  # messages in which a speed is constant, and changes that show the share of a slow base
# share of the limit from which the base may be at a lower limit of its own
_NEAR_LIMIT = 0.75

# Odometry is frozen; longer than total slip of 0.3 s, and at 20 Hz noticed within 0.5 s.
_FROZEN = 0.35  # s for which the pose is the same although the robot is commanded to move
_REPEATED = 0.3  # s; also if the velocity repeats exactly
_SAME = 0.1  # share of the reported motion below which a pose is the same

_COMPARED = 0.8  # s of motion that show the delay of a base
# s by which a base may seem later than `latency`, and the step between two delays: one message
_LATEST = 0.6
_LATE_STEP = 0.05
_WEAKER = (0.5, 0.6, 0.7, 0.8)  # shares of the described change of speed that are compared, too
_JUDGED = 0.5  # s between two estimates of the delay and the share while there is no fault
# estimates in a row by which a base seems to react before its commands: then `latency` is too high
_FEWEST_EARLY = 4
_KEPT = 1.5  # s for which states and commands are kept: `_COMPARED` and `_LATEST`
# shares of the commanded speed from which a base is said to be slow or fast
_SLOW = 0.75
_FAST = 1.05
# share up to which the description is called implausible: a loaded base, and 10 % of noise and lag
_IMPLAUSIBLE = 0.55
_STEADY = 1.0  # s for which it must be so
_LEAST_TOLERANCE = {"m/s": 0.04, "rad/s": 0.1}  # noise and dead bands of small bases
_PLACES = {"m/s": "position", "rad/s": "heading"}
_VERBS = {"move": "drives", "turn": "turns"}  # of a base that is slower than commanded


class Fault(enum.Enum):
    """Kind of deviation of the base from its commands; the value is its message."""

    STILL = (
        "does not {verb} as commanded: {shown}: {hint}blocked wheels, an obstacle, motors off, "
        "commands that arrive late, or odometry that is frozen or shows too little"
    )
    REVERSED = "{verb}s in the wrong direction: {shown}: motors or odometry with the wrong sign"
    EXCESS = "{verb}s although it was not commanded to: {shown}"
    CONSTANT = (
        "does not follow its commands: {shown}, constantly: another program may steer it, or it "
        "cannot reach the described {limit:.2f} {unit} (see calibrate)"
    )


# first: a cause that is added to a message takes the place of its end
_NEVER_BACKWARD = "set limits.v_back: 0 if it never drives backward; else "


@dataclass(frozen=True, slots=True)
class Gap:
    """The time between two messages."""

    elapsed: float  # s, by their stamps
    began: float  # s; real times of the messages
    ended: float


class Debounce:
    """Determines whether a condition persists, by the stamps and in real time."""

    def __init__(self) -> None:
        self._seconds = 0.0
        self._since = math.inf

    def update(self, holds: bool, gap: Gap, needed: float = _PERSISTS) -> bool:
        """Add the gap before a message if the condition `holds`, else reset.

        Return whether it persists for `needed` s.
        """
        if not holds:
            self._seconds = 0.0
            self._since = math.inf
            return False
        self._since = min(self._since, gap.began)
        # One message says little about a gap above 0.1 s, unless the gap is very long.
        is_very_long = gap.elapsed >= _VERY_LONG_GAP - ROUNDING
        self._seconds += gap.elapsed if is_very_long else min(gap.elapsed, 0.1)
        in_real_time = gap.ended - self._since >= _LEAST_REAL_TIME - ROUNDING
        return self._seconds >= needed - ROUNDING and in_real_time


@dataclass(frozen=True, slots=True)
class Measured:
    """The measured speed of one axis in m/s or rad/s: last, mean, and by the poses."""

    time: float  # s
    last: float
    mean: float
    by_pose: float


class AxisWatch:
    """Compares the measured speeds of one axis with those of bases that follow its commands.

    A speed outside the range of `Response` is a fault. A base that reaches a quarter of the
    commanded speeds or more is slow, which is no fault. Plans that start at the measured speed
    conceal bases that do not respond at all: their speed departs from the commands, or is constant
    without being a share of the commands that was seen while the speed changed.

    Twist and poses must both show a fault: where they contradict each other, one of them is wrong.
    """

    def __init__(self, axis: Axis, latency: float, lag: float) -> None:
        self._axis = axis
        self.tolerance = min(max(0.04 * axis.limit, _LEAST_TOLERANCE[axis.unit]), 0.4 * axis.limit)
        self.commands = Commands(axis.limit)
        self._early = min(latency, _EARLY)
        self._lag = lag
        earliest = -round(latency / _LATE_STEP)
        late = range(earliest, round(_LATEST / _LATE_STEP) + 1)
        strengths = np.array([*[1.0] * len(late), *_WEAKER])
        self.delays = _LATE_STEP * np.array([*late, *[0] * len(_WEAKER)])
        """Times in s by which the base may be later than `latency`, shape (n,); then those of weak
        bases, which only seem late."""
        is_prompt = (self.delays >= -self._early - ROUNDING) & (self.delays <= LATE + ROUNDING)
        self._is_prompt = is_prompt & (strengths == 1.0)
        self._response = Response(axis, lag, self._early, self.delays.tolist(), strengths.tolist())
        self._delayed: deque[tuple[float, FloatArray]] = deque()  # times in s and speeds
        self._speeds: deque[tuple[float, float]] = deque()  # times in s and mean speeds
        self._fault = Debounce()
        self._departure = _Departure(axis, self.tolerance)
        # shares of the commands in time and of the late ones
        self._shares: deque[tuple[float, float]] = deque(maxlen=_FEWEST)
        self._last_change = (-math.inf, 0.0)  # s, speed
        self._share = _SteadyShare(axis)

    @property
    def share(self) -> float:
        """The share of the commanded speed if it has differed for a second, else 1."""
        return self._share.value

    def most_different(self, speed: float, time: float) -> float:
        """Return the command of the last 0.3 s before `time` that differs most from a speed."""
        return max(self.commands.between(time - _DEPARTS, time), key=lambda sent: abs(sent - speed))

    def start(self, time: float, speed: float) -> None:
        """Start at a speed at `time` (s)."""
        self._response.start(time, speed)
        self._delayed.append((time, self._response.delayed))

    def delayed(self, number: int) -> FloatArray:
        """Return the speeds of bases that are late by `delays`, at the last messages.

        The shape is (number, n).
        """
        speeds = [speeds for _, speeds in self._delayed]
        return np.array(speeds[-number:])

    def update(self, measured: Measured, gap: Gap) -> Fault | None:
        """Process a speed; return the fault that persists."""
        time = measured.time
        speed = measured.mean
        self._observe_change(time, measured.last)
        self._speeds.append((time, speed))
        while self._speeds[0][0] < time - _CONSTANT - self._lag - ROUNDING:
            self._speeds.popleft()
        self._response.advance(time - gap.elapsed, time, self.commands)
        self._delayed.append((time, self._response.delayed))
        while self._delayed[1][0] <= time - _KEPT:  # as states are kept, to compare with them
            self._delayed.popleft()
        recent = self.commands.between(time - LATE, time + self._early)
        described = self._response.delayed[self._is_prompt].tolist()
        self._share.update(speed, described, gap)
        departs = self._departure.update(speed, recent, gap)
        fault = self._deviation(speed)
        if self._deviation(measured.by_pose) is None:
            fault = None
        faster = max(abs(speed), abs(measured.by_pose))
        is_agreed = abs(speed - measured.by_pose) < max(self.tolerance, 0.5 * faster)
        if fault is None and is_agreed and self._is_constant(time, speed):
            fault = Fault.CONSTANT
        needed = _CONSTANT_PERSISTS if fault is Fault.CONSTANT else _PERSISTS
        persists = self._fault.update(fault is not None, gap, needed)
        behind = self.commands.between(time - LATE - 2.0 * self._lag, time + self._early)
        if departs and is_agreed and 0.0 not in behind:
            fault = Fault.STILL
        elif not persists:
            return None
        is_opposite = speed * self.commands.at(time) <= -self.tolerance * abs(recent[-1])
        return Fault.REVERSED if fault is Fault.STILL and is_opposite and recent[-1] else fault

    def _deviation(self, speed: float) -> Fault | None:
        """Return the fault of a speed that is outside the range of the response."""
        low = self._response.low
        high = self._response.high
        beyond = _BEYOND * self.tolerance
        if not _GAIN * min(low, 0.0) - beyond <= speed <= _GAIN * max(high, 0.0) + beyond:
            return Fault.EXCESS
        least = self._response.least
        is_opposite = speed * least < 0.0 and abs(speed - least) >= beyond
        is_slow = abs(least) >= self.tolerance and speed * least < _QUARTER * least * least
        is_slow = is_slow and not low <= speed <= high  # as of a loaded base
        return Fault.STILL if is_opposite or is_slow else None

    def _is_constant(self, time: float, speed: float) -> bool:
        """Return whether the speed is constant and no known share of the commands."""
        since = self._speeds[0][0]
        speeds = [value for _, value in self._speeds]
        if len(speeds) < _FEWEST or time - since < _CONSTANT + self._lag - 2.0 * STEP - ROUNDING:
            return False
        if max(speeds) - min(speeds) > 0.5 * self.tolerance:
            return False
        # The last commands cannot be the cause of a speed that was constant before.
        sent = self.commands.between(since, time - LATE - self._lag + self._early)
        if min(sent) - self.tolerance < speed < max(sent) + self.tolerance:
            return False
        is_slower = all(command * speed >= speed * speed for command in sent)
        if is_slower and abs(speed) >= _NEAR_LIMIT * self._axis.limit:
            return False
        greatest = max(map(abs, sent))
        if greatest == 0.0:
            return False  # it moves although it is not commanded to
        share = min(1.0, abs(speed) / greatest)
        if share * (max(sent) - min(sent)) >= 2.0 * self.tolerance:
            return True
        possible = [share * command for pair in self._shares for share in pair for command in sent]
        return not (
            possible and min(possible) - self.tolerance <= speed <= max(possible) + self.tolerance
        )

    def _observe_change(self, time: float, speed: float) -> None:
        """Record which shares of the commands the base reaches while its speed changes."""
        then, before = self._last_change
        if time - then < 0.5 * _SMOOTHING - ROUNDING:
            return
        self._last_change = time, speed
        if abs(speed - before) < 0.05 * self.tolerance:
            return
        if abs(speed - before) > 1.5 * self._axis.rate * (time - then) + self.tolerance:
            self._shares.clear()  # after a jump, earlier shares do not apply
        in_time = self.commands.at(time)
        late = self.commands.at(time - LATE)
        if in_time * late > 0.0 and min(abs(in_time), abs(late)) >= 2.0 * self.tolerance:
            self._shares.append((speed / in_time, speed / late))


class _Departure:
    """A speed that departs from all recent commands, further than these change."""

    def __init__(self, axis: Axis, tolerance: float) -> None:
        self._axis = axis
        self._tolerance = tolerance
        self._before = 0.0
        self._nearest = 0.0  # last command
        self._side = 0.0
        self._restart()

    def _restart(self) -> None:
        self._departed = 0.0
        self._expected = 0.0
        self._seconds = 0.0

    def update(self, speed: float, recent: Sequence[float], gap: Gap) -> bool:
        """Process a speed and the recent commands; return whether it departs."""
        margin = 0.25 * self._tolerance
        side = float(speed > max(recent) + margin) - float(speed < min(recent) - margin)
        nearest = max(recent) if side > 0.0 else min(recent)
        departed = side * (speed - self._before)
        expected = _GAIN * max(0.0, side * (nearest - self._nearest))
        is_departing = side != 0.0 and departed >= _QUARTER * self._axis.rate * gap.elapsed
        is_other = side != self._side or gap.elapsed > _LONG_GAP
        self._before = speed
        self._nearest = nearest
        self._side = side
        if is_other or not is_departing:
            self._restart()
            return False
        # More is a drop to a part of the speed, as of a slow base.
        self._departed += min(departed, 1.5 * self._axis.rate * gap.elapsed)
        self._expected += expected
        self._seconds += gap.elapsed
        least = max(2.0 * self._tolerance, self._expected + 0.5 * self._tolerance)
        return self._departed >= least and self._seconds >= _DEPARTS - ROUNDING


class _SteadyShare:
    """The share of the commanded speed that a base reaches, if it is slow or fast."""

    def __init__(self, axis: Axis) -> None:
        self._least_command = 0.2 * axis.limit  # in slower motion, noise and dead bands count more
        self._seconds = 0.0
        self._mean = 1.0

    @property
    def value(self) -> float:
        """The share if it has differed from 1 for more than a second, else 1."""
        is_clear = not _SLOW <= self._mean < _FAST  # else the base was now slow, now fast
        return self._mean if is_clear and self._seconds >= _STEADY else 1.0

    def update(self, speed: float, described: Sequence[float], gap: Gap) -> None:
        """Process a speed, and those of bases as described that react early to late."""
        slowest = min(described, key=abs)
        fastest = max(described, key=abs)
        if abs(slowest) < self._least_command:
            return
        share = speed / slowest
        if share > 1.0:
            share = max(1.0, speed / fastest)
        passed = min(gap.elapsed, 0.1)
        if 0.0 < share < _SLOW or _FAST <= share <= _GAIN:
            self._mean += (share - self._mean) * passed / (self._seconds + passed)
            self._seconds = min(self._seconds + passed, 2.0 * _STEADY)
        # of a changing speed, nothing between theirs says that the base is no faster
        elif self._mean < 1.0 or abs(fastest) < _FAST * abs(slowest):
            self._seconds = max(0.0, self._seconds - passed)


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
        self._robot = robot
        self._latency = latency
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
            self._latency = latency
            self.foresight = Foresight(self._robot, latency)
        self._forget()

    def _forget(self) -> None:
        self._axes = {
            axis: AxisWatch(axis, self._latency, self._robot.lag) for axis in self._robot.axes
        }
        self._ahead = next(iter(self._axes.values()))
        self._last = STOP
        self._fault: tuple[Axis, Fault] | None = None  # the first one
        self._point_at_fault = ""  # while the robot then brakes, the motion may hide it
        self._delay = ""
        self._early_in_a_row = 0
        self._is_early = False
        self._judged = -math.inf  # s
        self._states: deque[tuple[float, RobotState]] = deque()
        self._received = -math.inf
        self._answered = math.inf

    @property
    def remark(self) -> str:
        """A sentence on a slow, fast, early or late base, and on odometry of another point."""
        parts = [
            f"{_VERBS[axis.verb]} at about {_percent(watch.share)} % of the commanded speed"
            for axis, watch in self._axes.items()
            if watch.share != 1.0
        ]
        slow = f"the base {' and '.join(parts)}" if parts else ""
        if any(watch.share < _IMPLAUSIBLE for watch in self._axes.values()):
            slow += ", so its description is implausible: `calibrate` measures its limits"
        delay = self._delay or (self._early_text() if self._is_early else "")
        if parts:
            delay = ""  # such a base only seems to be late
        return "; ".join(filter(None, (slow, delay, self._point.remark)))

    @property
    def cause(self) -> str:
        """The cause of a fault that the motion before and after it shows; else empty."""
        point = self._named_point() or self._point_at_fault
        return "; ".join(filter(None, (point, self._delay)))

    def _named_point(self) -> str:
        """Return which point odometry describes, if that may be the cause of the fault."""
        is_driving = self._fault is not None and self._fault[0].verb == "move"
        return self._point.suspicion() if is_driving else self._point.remark

    def sent(self, time: float, command: Command | None, now: float = -math.inf) -> None:
        """Record a command that was sent in response to a state of `time` (s), at `now` in real s.

        None: another program moves the base, so its motion is not compared with our commands.
        """
        self.foresight.sent(time, command)
        if command is None:
            self._forget()
            return
        self._answered = min(self._answered, now)
        self._last = command
        for axis, watch in self._axes.items():
            watch.commands.add(time + self._latency, getattr(command, axis.name))

    def fault(self, time: float, robot: RobotState, now: float) -> str | None:
        """Process odometry of `time` (s), received at `now` (real s).

        Return the fault in words, or None.
        """
        if self._states and time < self._states[-1][0]:
            self._forget()
        if not self._states:
            for axis, watch in self._axes.items():
                watch.start(time, getattr(robot, axis.name))
            self._states.append((time, robot))
        gap = Gap(time - self._states[-1][0], self._received, now)
        self._delay_late_answer(gap)
        self._received = now
        self._answered = math.inf
        self._states.append((time, robot))
        while self._states[1][0] <= time - _KEPT:
            self._states.popleft()
        faults = {
            axis: found
            for axis, watch in self._axes.items()
            if (found := watch.update(self._measured(axis), gap)) is not None
        }
        if not self._robot.moves_sideways:
            self._point.update(time, robot.pose, self._ahead.commands.at(time))
        self._judge_delay(time)
        if faults and self._fault is None:
            self._fault = next(iter(faults.items()))
            self._point_at_fault = self._named_point()
        for watch in self._axes.values():
            watch.commands.forget(time - _KEPT)
        frozen = self._frozen(time, robot)
        if frozen is not None or not faults:
            return frozen
        axis, found = next(iter(faults.items()))
        return self._message(axis, found, robot)

    def _delay_late_answer(self, gap: Gap) -> None:
        """Let a command that was sent late in a long gap act later.

        In a short gap it acts from the start: a simulation may have waited for it.
        """
        late = self._answered - gap.began
        if gap.elapsed > _LONG_GAP and 0.0 < late < gap.ended - gap.began:
            for watch in self._axes.values():
                watch.commands.delay_last(late / (gap.ended - gap.began) * gap.elapsed)

    def _measured(self, axis: Axis) -> Measured:
        """Return the last speed of an axis."""
        time, robot = self._states[-1]
        recent = self._since(time - _SMOOTHING) or list(self._states)
        began, first = recent[0]
        speeds = [getattr(state, axis.name) for _, state in recent[1:]]
        mean = sum(speeds) / len(speeds)
        elapsed = time - began
        moved = _moved(first, robot)[axis.name]
        by_pose = moved / elapsed if elapsed > 0.0 else mean
        return Measured(time, getattr(robot, axis.name), mean, by_pose)

    def _frozen(self, time: float, robot: RobotState) -> str | None:
        """Return the fault if the pose is constant while commands and twist are not."""
        repeated = all(state == robot for _, state in self._since(time - _REPEATED))
        recent = self._since(time - (_REPEATED if repeated else _FROZEN))
        if not recent:
            return None
        began, first = recent[0]
        states = [state for _, state in recent]
        elapsed = time - began
        if elapsed > _LONG_GAP * len(states):
            return None  # messages are missing, between which the robot may have moved to and fro
        for axis, watch in self._axes.items():
            reported = getattr(robot, axis.name)
            sign = math.copysign(1.0, reported)
            least = min(sign * getattr(state, axis.name) for state in states)
            commanded = min(sign * sent for sent in watch.commands.between(began, time))
            moved = max(abs(_moved(first, state)[axis.name]) for state in states)
            moves = min(least, commanded) >= watch.tolerance
            if moves and moved < _SAME * least * elapsed:
                return (
                    f"odometry is frozen: it reports {_speeds(robot, self._axes)}, but its "
                    f"{_PLACES[axis.unit]} has been constant for {elapsed:.2f} s "
                    f"(velocity {reported:.2f} {axis.unit})"
                )
        return None

    def _judge_delay(self, time: float) -> None:
        """Determine whether the base reacts later or earlier than `latency`."""
        if self._fault is None and time - self._judged < _JUDGED:
            return
        self._judged = time
        for axis, watch in self._axes.items():
            delay = self._delay_of(time, axis, watch)
            if delay > 0.0:
                self._delay = (
                    f"the base reacts later than `latency` {self._latency:g} s: raise it "
                    "(`calibrate` measures it)"
                )
            elif delay < 0.0:
                self._delay = self._early_text()

    def _early_text(self) -> str:
        return (
            f"the base reacts earlier than `latency` {self._latency:g} s: lower it "
            "(`calibrate` measures it)"
        )

    def _delay_of(self, time: float, axis: Axis, watch: AxisWatch) -> float:
        """Return by how much later than `latency` the base follows the commands of an axis, in s.

        Negative if it is earlier; 0 if no delay that it may have explains its motion much better.
        """
        recent = self._since(time - _COMPARED) or list(self._states)
        speeds = np.array([getattr(state, axis.name) for _, state in recent])
        if np.ptp(speeds) < 2.0 * watch.tolerance:
            return 0.0  # a base that does not move does not react later
        delayed = watch.delayed(len(recent))
        squares = np.maximum((delayed**2).sum(axis=0), ROUNDING)
        shares = np.clip(speeds @ delayed / squares, _QUARTER, 1.0)  # a slow base only seems late
        off = np.abs(speeds[:, None] - shares * delayed).mean(axis=0)
        latest = LATE + self._robot.lag + ROUNDING  # the described lag may be too short
        is_usual = (watch.delays >= -_EARLY - ROUNDING) & (watch.delays <= latest)
        best = int(np.argmin(off))
        delay = float(watch.delays[best])
        is_early = delay < -_LATE_STEP - ROUNDING
        self._early_in_a_row = self._early_in_a_row + 1 if is_early else 0
        self._is_early = self._is_early or self._early_in_a_row >= _FEWEST_EARLY
        usual = off[is_usual].min()
        if is_usual[best] or usual < 0.5 * watch.tolerance:
            return 0.0
        most = min(0.5 * usual, 0.5 * np.abs(speeds).mean(), watch.tolerance)
        return delay if off[best] < most else 0.0

    def _since(self, time: float) -> list[tuple[float, RobotState]]:
        """Return the states from the last one at or before `time` (s) on, if there is one."""
        before = [index for index, (then, _) in enumerate(self._states) if then <= time + ROUNDING]
        return list(self._states)[before[-1] :] if before else []

    def _message(self, axis: Axis, fault: Fault, robot: RobotState) -> str:
        """Return the fault of an axis in words."""
        commanded = _speeds(self._last, self._axes)
        measured = _speeds(robot, self._axes)
        shown = f"commanded to {commanded}, odometry shows {measured}"
        if self._delay:  # the newest command and state may then be equal by chance
            return self._delay if commanded == measured else f"{self._delay}: {shown}"
        if commanded == measured:
            mean = self._measured(axis).mean
            sent = self._axes[axis].most_different(mean, self._states[-1][0])
            shown = f"commanded to {sent:.2f}, odometry showed {mean:.2f} {axis.unit}"
        is_backward = axis.name == "vx" and self._last.vx < 0.0
        stands = robot.vx > _STANDS * self._last.vx
        hint = _NEVER_BACKWARD if is_backward and stands else ""
        text = fault.value.format(
            verb=axis.verb, shown=shown, hint=hint, limit=axis.limit, unit=axis.unit
        )
        return f"the base {text}"


def _speeds(moving: Command | RobotState, axes: Sequence[Axis] | dict[Axis, AxisWatch]) -> str:
    """Return the velocities of all axes in words."""
    return " and ".join(f"{getattr(moving, axis.name):.2f} {axis.unit}" for axis in axes)


def _percent(share: float) -> int:
    """Return a share in percent: in steps of ten below 1."""
    return round(100 * share) if share > 1.0 else 10 * round(10 * share)


def _moved(before: RobotState, after: RobotState) -> dict[str, float]:
    """Return by how much a robot moved along each axis, in m and rad."""
    turned = wrap_angle(after.pose.yaw - before.pose.yaw)
    middle = before.pose._replace(yaw=before.pose.yaw + 0.5 * turned)
    moved = middle.relative(after.pose)
    return {"vx": moved.x, "vy": moved.y, "w": turned}
