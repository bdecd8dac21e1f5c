"""Watch whether the base follows its commands, by odometry (without ROS; both clocks are passed in)."""

from __future__ import annotations

import bisect
import enum
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from ator_ros.geometry import wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.robot.response import Foresight, clip
from ator_ros.world.state import STOP, Command, RobotState

_DELAY = 0.1  # s by which a base may be later than `latency`: two messages at 20 Hz
_WINDOW = 0.3  # s of commands that are judged, besides twice the lag of the motors
_PERSISTS = 0.15  # s: three messages at 20 Hz; noise does not last as long
_LEAST_REAL_TIME = 0.1  # s in which commands reach the base, however fast simulated time passes
_LONG_GAP = 0.15  # s between two messages, after which a base with a watchdog may have stopped by itself
_SMOOTHING = 0.1  # s over which measured velocities are averaged
_QUARTER = 0.25  # share of the expected motion; a base that shows less does not follow
_COASTING = 0.25  # s for which a base may keep a speed beyond its commands
_BEYOND = 1.5  # times the tolerance
_LOSES = 0.3  # s in which a base that follows does not go on losing speed below its commands
_STEP = 0.025  # s of a step of the prediction

# A speed that is constant whatever is commanded: see `Axis._is_constant`.
_CONSTANT = 0.25  # s of motion that are judged, besides the lag of the motors
_FEWEST = 4  # messages in that time, and messages from which the share is known
_VARIES = 0.5  # times the tolerance
_NEAR_LIMIT = 0.75  # of the described limit; a base as fast may have a somewhat lower limit of its own
_CONSTANT_PERSISTS = 0.06  # s for which it persists, in two messages at least
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Limits and thresholds of one axis (driving or turning), in m and m/s or in rad and rad/s.

    Attributes
    ----------
    limit, rate, lag, stop : float
        As described: greatest speed, its greatest change per second, time constant in s of the motors, and
        change of speed per second when commanded to stand.
    tolerance : float
        Difference of speeds that is ignored: 4 % of the limit, at least 0.04 m/s or 0.1 rad/s (noise, dead
        band), at most 40 % of the limit.
    window : float
        Time in s over which the measured change of speed is compared with the predicted one.
    moved : float
        Motion after which a constant pose counts as frozen: 3 cm or 0.08 rad.
    """

    limit: float
    rate: float
    lag: float
    stop: float
    tolerance: float
    window: float
    moved: float

    @classmethod
    def of(cls, robot: Robot) -> tuple[Thresholds, Thresholds]:
        """Return those of driving and those of turning."""
        limits, lag = robot.limits, robot.motor_time_constant
        window = _WINDOW + 2.0 * lag
        v, w = (min(max(0.04 * x, least), 0.4 * x) for x, least in ((limits.v, 0.04), (limits.w, 0.1)))
        return (
            cls(limits.v, min(limits.a, limits.brake), lag, robot.stop.backward, v, window, 0.03),
            cls(limits.w, limits.aw, lag, robot.stop.turning, w, window, 0.08),
        )


class Fault(enum.Enum):
    """How the base does not follow its commands, in words."""

    STILL = (
        "does not {move} as commanded: {shown}: blocked wheels, an obstacle, motors off, or odometry that is "
        "frozen or shows too little"
    )
    REVERSED = "{move}s in the wrong direction: {shown}: motors or odometry with the wrong sign"
    EXCESS = "{move}s although it was not commanded to: {shown}"
    CONSTANT = (
        "does not follow its commands: {shown}, constantly: another program may steer it, or it cannot reach "
        "the described {limit:.2f} {unit} (see calibrate)"
    )


class Debounce:
    """How long a condition has held without a break, by the stamps and in real time."""

    def __init__(self) -> None:
        self._seconds, self._since = 0.0, math.inf

    def update(self, holds: bool, gap: Gap, needed: float = _PERSISTS) -> bool:
        """Add the gap before a message if the condition `holds`, else reset; return whether it persists."""
        if not holds:
            self._seconds, self._since = 0.0, math.inf
            return False
        self._since = min(self._since, gap.began)
        # One message shows little of the gap before it, unless the gap is very long.
        self._seconds += gap.elapsed if gap.elapsed >= _WINDOW - _ROUNDING else min(gap.elapsed, 0.1)
        in_real_time = gap.ended - self._since >= _LEAST_REAL_TIME - _ROUNDING
        return self._seconds >= needed - _ROUNDING and in_real_time


@dataclass(frozen=True, slots=True)
class Gap:
    """The time between two messages: s by their stamps, and when both came, in real time."""

    elapsed: float
    began: float
    ended: float


class Axis:
    """Compares one velocity of the base with the commands.

    The speed that was measured a window ago is predicted forward under the commands sent since, for a base
    that may be late. The base must have made at least a quarter of the predicted change. A base that reaches
    a quarter of the commanded speeds or more is slow, which is no fault, unless it keeps a constant speed
    that is not its share of the commands: plans that begin at the measured speed hide such a base.
    """

    def __init__(self, thresholds: Thresholds) -> None:
        self.thresholds = thresholds
        self._measured: deque[tuple[float, float]] = deque()
        self._smooth: deque[tuple[float, float]] = deque()
        self._fault = Debounce()
        self._constant = False
        self._slow_for, self._share = 0.0, 1.0
        self._lost, self._eased, self._lost_for, self._commanded = 0.0, 0.0, 0.0, 0.0
        self._shares: deque[tuple[float, float]] = deque(maxlen=_FEWEST)
        self._last_response = -math.inf, 0.0

    @property
    def share(self) -> float:
        """The speed as a share of the commanded one, if it has been lower for more than a second; else 1."""
        return self._share if self._slow_for >= 1.0 else 1.0

    @property
    def speed(self) -> float:
        """The last speed, averaged."""
        return self._smooth[-1][1]

    def update(self, time: float, speed: float, commands: Commands, gap: Gap) -> Fault | None:
        """Take the speed at `time` (s); return the fault that persists."""
        self._observe_response(time, speed, commands)
        self._measured.append((time, speed))
        while self._measured[0][0] < time - _SMOOTHING + _ROUNDING:
            self._measured.popleft()
        speed = sum(value for _, value in self._measured) / len(self._measured)
        self._smooth.append((time, speed))
        while len(self._smooth) > 1 and self._smooth[1][0] <= time - self.thresholds.window + _ROUNDING:
            self._smooth.popleft()
        if len(self._smooth) == 1:
            return None
        limit = self.thresholds.limit
        recent = [clip(command, limit) for command in commands.between(time - _DELAY, time)]
        fault = self._judge(time, speed, recent, commands, gap)
        was_constant, self._constant = self._constant, fault is Fault.CONSTANT
        needed = _CONSTANT_PERSISTS if was_constant and self._constant else _PERSISTS
        persists = self._fault.update(fault is not None, gap, needed)
        stood = 0.0 in commands.between(time - _DELAY - 2.0 * self.thresholds.lag, time)
        loses = not stood and self._loses(speed, min(recent), max(recent), gap)
        self._observe_share(speed, recent, gap.elapsed)
        return fault if persists else Fault.STILL if loses else None

    def _judge(
        self, time: float, speed: float, recent: Sequence[float], commands: Commands, gap: Gap
    ) -> Fault | None:
        tolerance = self.thresholds.tolerance
        since, before = self._smooth[0]
        fast = [0.0, before, *self._fast(since, before, time, commands)[-round(_COASTING / _STEP) :]]
        if not min(fast) - _BEYOND * tolerance <= self._measured[-1][1] <= max(fast) + _BEYOND * tolerance:
            return Fault.EXCESS
        # At the beginning of the window the base may have just begun to move.
        fastest = max(self._smooth, key=lambda each: abs(each[1]))
        share = min(0.99, max(self._share_at(*each, commands) for each in (self._smooth[0], fastest)))
        slow, part = (self._slow(since, before, time, commands, each) for each in (1.0, share))
        # The magnitudes between which the speed should be now, in the direction of the commands.
        least = max(0.0, min(part, share * min(recent))) + min(0.0, max(part, share * max(recent)))
        ahead, gained = (
            abs(least) - math.copysign(1.0, least) * before,
            math.copysign(1.0, least) * (speed - before),
        )
        approached = ahead > 0.0 and gained >= _QUARTER * ahead
        if abs(least) >= tolerance and _is_below_quarter(speed, least) and not approached:
            return Fault.STILL
        if gap.elapsed > _LONG_GAP:
            return None  # a base with a watchdog of its own has stopped, and started again
        sign = math.copysign(1.0, before)
        most = max(sign * slow, *(sign * command for command in recent))
        had, has = sign * before, sign * speed
        if had - most >= tolerance and had - has < _QUARTER * (had - most):
            return Fault.EXCESS
        spans = [_CONSTANT + self.thresholds.lag]
        if all(_is_below_quarter(speed, command) for command in recent):
            spans.append(self.thresholds.window)  # in which the commands vary more
        if any(self._is_constant(time, seconds, recent, commands) for seconds in spans):
            return Fault.CONSTANT
        return None

    def _is_constant(self, time: float, seconds: float, recent: Sequence[float], commands: Commands) -> bool:
        """Return whether the speed is constant and differs from the commands, and no slow base explains it.

        A slow base reaches a share of the commands, which was seen while its speed changed, or a limit of its
        own not far below the described one.
        """
        axis = self.thresholds
        since = min(time - seconds, self._smooth[-min(_FEWEST, len(self._smooth))][0])
        shown = [(then, value) for then, value in self._smooth if then >= since - _ROUNDING]
        speeds = [value for _, value in shown]
        if len(speeds) < _FEWEST or max(speeds) - min(speeds) > _VARIES * axis.tolerance:
            return False
        speed = speeds[-1]
        # The last commands explain no speed that was constant before.
        sent = [clip(command, axis.limit) for command in commands.between(since, time - _DELAY)]
        low, high = min(sent), max(sent)
        if low - axis.tolerance < speed < high + axis.tolerance:
            return False
        slower = all(command * speed >= speed * speed for command in sent)
        if slower and abs(speed) >= _NEAR_LIMIT * axis.limit:
            return False
        known = [
            sum(acting) / len(acting)
            for then, _ in shown
            if then <= time - _DELAY - axis.lag
            for acting in [commands.between(then - _SMOOTHING, then)]
        ]
        if known and max(known) - min(known) >= 2.0 * axis.tolerance:
            return True
        possible = [share * command for pair in self._shares for share in pair for command in recent]
        return not (possible and min(possible) - axis.tolerance <= speed <= max(possible) + axis.tolerance)

    def _share_at(self, time: float, speed: float, commands: Commands) -> float:
        """Return the speed as a share of the commands at `time`, at least a quarter; 1 without a command."""
        command = max(commands.between(time - _DELAY - 2.0 * self.thresholds.lag, time), key=abs)
        if abs(command) < self.thresholds.tolerance or speed * command <= 0.0:
            return 1.0
        return min(1.0, max(_QUARTER, speed / command))

    def _slow(self, since: float, speed: float, time: float, commands: Commands, share: float) -> float:
        """Return the speed at `time` of a base that had `speed` at `since`, is late and lags.

        Toward a lower share it brakes as hard as bases do that are commanded to stand.
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

    def _fast(self, since: float, speed: float, time: float, commands: Commands) -> list[float]:
        """Return the speeds until `time` of a base that changes its speed twice as fast as described."""
        speeds, (count, dt) = [], _steps(time - since)
        for command in commands.sampled(since + dt, dt, count):
            speed += clip((speed if command is None else command) - speed, 2.0 * self.thresholds.rate * dt)
            speeds.append(speed)
        return speeds

    def _loses(self, speed: float, low: float, high: float, gap: Gap) -> bool:
        """Return whether the axis goes on losing speed, although it has less than every recent command.

        A base that drops to a part of its speed, and keeps that, is slow, but follows.
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
        lost = min(lost, 1.5 * self.thresholds.rate * gap.elapsed)  # more is a drop, as to half the speed
        self._lost, self._eased = self._lost + lost, self._eased + eased
        self._lost_for += gap.elapsed
        tolerance = self.thresholds.tolerance
        enough = self._lost >= max(2.0 * tolerance, self._eased + 0.5 * tolerance)
        return enough and self._lost_for >= _LOSES - _ROUNDING

    def _observe_response(self, time: float, speed: float, commands: Commands) -> None:
        """Note which share of the commands the base reaches while its speed changes, if it is late or not."""
        axis, (then, before) = self.thresholds, self._last_response
        if time - then < 0.5 * _SMOOTHING - _ROUNDING:
            return
        self._last_response = time, speed
        if abs(speed - before) < 0.05 * axis.tolerance:
            return
        if abs(speed - before) > 1.5 * axis.rate * (time - then) + axis.tolerance:
            self._shares.clear()  # a jump: what was before says nothing any more
        sent = [clip(commands.between(late, late)[0], axis.limit) for late in (time, time - _DELAY)]
        if min(abs(command) for command in sent) >= 2.0 * axis.tolerance and sent[0] * sent[1] > 0.0:
            self._shares.append((speed / sent[0], speed / sent[1]))

    def _observe_share(self, speed: float, recent: Sequence[float], elapsed: float) -> None:
        """Note which share of the commanded speed the base reaches."""
        command = min(recent, key=abs)
        if abs(command) < 0.2 * self.thresholds.limit:
            return
        share = speed / command
        if 0.0 < share < 0.75:
            passed = min(elapsed, 0.1)
            self._share += (share - self._share) * (passed / (self._slow_for + passed))
            self._slow_for = min(self._slow_for + passed, 2.0)
        else:
            self._slow_for = max(0.0, self._slow_for - min(elapsed, 0.1))


class Commands:
    """The commands of one axis, by the time in s from which they act."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._sent: list[float] = []

    def add(self, acts: float, command: float) -> None:
        """Note a command that acts from `acts` (s) on; it replaces later ones."""
        earlier = bisect.bisect_left(self._times, acts)
        self._times[earlier:], self._sent[earlier:] = [acts], [command]

    def delay_last(self, seconds: float) -> None:
        """Let the last command act later."""
        if self._times:
            self._times[-1] += seconds

    def forget(self, time: float) -> None:
        """Forget the commands that act no more at `time` (s)."""
        over = max(0, bisect.bisect_right(self._times, time) - 1)
        del self._times[:over], self._sent[:over]

    def between(self, since: float, until: float) -> list[float]:
        """Return the commands that acted between two times in s; where there was none, to stand."""
        begin, end = (bisect.bisect_right(self._times, time + _ROUNDING) for time in (since, until))
        return [self._sent[begin - 1] if begin else 0.0, *self._sent[begin:end]]

    def sampled(self, since: float, dt: float, count: int) -> list[float | None]:
        """Return the commands that act at `count` times in s from `since` on; None before the first one."""
        found = (bisect.bisect_right(self._times, since + step * dt + _ROUNDING) for step in range(count))
        return [self._sent[index - 1] if index else None for index in found]


class MotionWatch:
    """Compares odometry with the commands that were sent, driving and turning apart; predicts late states.

    Faults are those of `Fault`, and a pose that is constant while the velocity is not.

    With odometry below 6.7 Hz (at the default `odom_timeout`) the robot is commanded to stand between two
    messages. Then a late base and frozen odometry look alike. Some frozen odometry is not noticed, and the
    robot moves by centimeters meanwhile.

    `latency` is the time in s from the stamp of a state until the command that answers it moves the base.

    `foresight` predicts states, under the same commands.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self._robot, self._latency = robot, latency
        self._driving, self._turning = Thresholds.of(robot)
        self.foresight = Foresight(robot, latency)
        self._forget()

    def reset(self) -> None:
        """Forget all states and commands because time was reset."""
        self.foresight.reset()
        self._forget()

    def begin(self, latency: float, *, preempts: bool) -> None:
        """Begin to watch the base for a new goal, with a latency that may be another one.

        Motion before the goal is ignored, as others may have moved the base. A goal that `preempts` another
        continues its watch, and with the latency of before: its commands may still be under way.
        """
        if preempts:
            return
        if latency != self._latency:
            self._latency, self.foresight = latency, Foresight(self._robot, latency)
        self._forget()

    def _forget(self) -> None:
        self._v, self._w = Axis(self._driving), Axis(self._turning)
        self._commands = Commands(), Commands()
        self._last = STOP
        self._states: deque[tuple[float, RobotState]] = deque()
        self._received, self._answered = -math.inf, math.inf

    @property
    def remark(self) -> str:
        """A sentence on a base that is slower than commanded; empty if it is not."""
        parts = [
            f"{verb} at about {100 * round(axis.share, 1):.0f} % of the commanded speed"
            for verb, axis in (("drives", self._v), ("turns", self._w))
            if axis.share < 1.0
        ]
        return f"the base {' and '.join(parts)}" if parts else ""

    def sent(self, time: float, command: Command | None, now: float = -math.inf) -> None:
        """Note a command that was sent as the answer to a state of `time` (s).

        `now` is the real time in s at which it was sent, where that may be later than the state was received.
        None: another program moves the base, so its motion is not compared with our commands.
        """
        self.foresight.sent(time, command)
        if command is None:
            self._forget()
            return
        self._answered, self._last = min(self._answered, now), command
        for commands, value in zip(self._commands, (command.v, command.w), strict=True):
            commands.add(time + self._latency, value)

    def fault(self, time: float, robot: RobotState, now: float) -> str | None:
        """Take a state of the robot by odometry, at `time` s by its stamp and `now` s of real time.

        Return what is wrong, in words; None if the base moves as commanded.
        """
        last = self._states[-1] if self._states else (time, robot)
        if time < last[0]:
            self._forget()
        gap = Gap(time - last[0], self._received, now)
        self._delay_late_answer(gap)
        self._received, self._answered = now, math.inf
        self._states.append((time, robot))
        while len(self._states) > 1 and self._states[1][0] <= time - 1.0:
            self._states.popleft()
        v, w = self._shown(last[1], robot, gap)
        faults = [
            axis.update(time, speed, commands, gap)
            for axis, speed, commands in zip((self._v, self._w), (v, w), self._commands, strict=True)
        ]
        for commands in self._commands:
            commands.forget(time - 2.0 * self._driving.window)
        return self._frozen(time, robot) or self._message(robot, faults)

    def _delay_late_answer(self, gap: Gap) -> None:
        """Let a command that left late in a long gap act from then on.

        In a short gap it counts from the beginning: a simulation may have waited for it.
        """
        late = self._answered - gap.began
        if gap.elapsed > _LONG_GAP and 0.0 < late < gap.ended - gap.began:
            for commands in self._commands:
                commands.delay_last(late / (gap.ended - gap.began) * gap.elapsed)

    def _shown(self, before: RobotState, robot: RobotState, gap: Gap) -> tuple[float, float]:
        """Return the velocities that odometry shows.

        In a long gap a base that receives nothing stands by itself, after it has moved: either is an answer.
        """
        if gap.elapsed <= _LONG_GAP:
            return robot.v, robot.w
        seconds = min(gap.elapsed, self._driving.window)
        along, turned = _moved(before, robot)
        v = robot.v if abs(robot.v) >= self._driving.tolerance else along / seconds
        return v, robot.w if abs(robot.w) >= self._turning.tolerance else turned / seconds

    def _frozen(self, time: float, robot: RobotState) -> str | None:
        """Return the fault if the pose is constant while the velocity is not zero."""
        for axis, name, unit in ((0, "position", "m/s"), (1, "heading", "rad/s")):
            thresholds = (self._driving, self._turning)[axis]
            reported = (robot.v, robot.w)[axis]
            seconds = min(max(thresholds.moved / max(abs(reported), _ROUNDING), _PERSISTS), 0.35)
            since = [
                index for index, (then, _) in enumerate(self._states) if then <= time - seconds + _ROUNDING
            ]
            if abs(reported) < thresholds.tolerance or not since:
                continue
            states = [state for _, state in self._states][since[-1] :]
            least = min((state.v, state.w)[axis] * math.copysign(1.0, reported) for state in states)
            moved = max(abs(_moved(states[0], state)[axis]) for state in states)
            elapsed = time - self._states[since[-1]][0]
            if elapsed > _LONG_GAP * len(states):
                continue  # messages are missing: between these the robot may have gone to and fro
            if least >= thresholds.tolerance and moved < _QUARTER * least * elapsed:
                return (
                    f"odometry is frozen: it reports {robot.v:.2f} m/s and {robot.w:.2f} rad/s, "
                    f"but its {name} has been constant for {elapsed:.2f} s "
                    f"(velocity {reported:.2f} {unit})"
                )
        return None

    def _message(self, robot: RobotState, faults: Sequence[Fault | None]) -> str | None:
        """Return in words that the first axis with a fault has this fault."""
        shown = (
            f"commanded to {self._last.v:.2f} m/s and {self._last.w:.2f} rad/s, "
            f"odometry shows {robot.v:.2f} m/s and {robot.w:.2f} rad/s"
        )
        axes = ((self._v, self._last.v, "move", "m/s"), (self._w, self._last.w, "turn", "rad/s"))
        for fault, (axis, command, move, unit) in zip(faults, axes, strict=True):
            if fault is not None:
                against = axis.speed * command <= -axis.thresholds.tolerance * abs(command)
                fault = Fault.REVERSED if fault is Fault.STILL and against and command else fault
                limit = axis.thresholds.limit
                return f"the base {fault.value.format(move=move, shown=shown, limit=limit, unit=unit)}"
        return None


def _steps(seconds: float) -> tuple[int, float]:
    """Return the number of steps in which to predict, and their length in s."""
    count = math.ceil(seconds / _STEP - _ROUNDING)
    return count, seconds / count


def _is_below_quarter(speed: float, command: float) -> bool:
    """Return whether a speed is less than a quarter of the command, or in the other direction."""
    return speed * command < _QUARTER * command * command


def _moved(before: RobotState, after: RobotState) -> tuple[float, float]:
    """Return how far in m, with its direction along the heading, and by which angle in rad a robot moved."""
    distance, turned = before.pose.distance(after.pose), wrap_angle(after.pose.yaw - before.pose.yaw)
    ahead = before.pose.relative(after.pose).x
    return math.copysign(distance, ahead), turned
