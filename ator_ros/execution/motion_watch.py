"""Detection of a base that does not move as commanded, from odometry. Both clocks are passed in."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from ator_ros.geometry import wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.robot.ramp import ramped
from ator_ros.world.state import STOP, Command, RobotState

_TENTH = 0.1
_QUARTER = 0.25
_WINDOW = 0.1  # s over which the motion of the pose is measured
_LONGEST_GAP = 0.1  # s of the time between two states that count: more is not observed
_SHORTEST_WAIT = 0.1  # real s that commands need at least, however fast simulated time runs
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Thresholds above which motion that contradicts the commands is a fault, derived from the robot.

    Attributes
    ----------
    asked : float
        Speed of the faster wheel in m/s from which the base must follow a command: 4 % of the greatest
        speed, above the dead zone of a base.
    patience : float
        Time in s for which the base may not move, or move without a command: 0.2 s plus three time constants
        of the motors. Together with the time to brake it is below half a second.
    frozen : float
        Time in s in which the pose may contradict the velocity: three messages at 20 Hz.
    v, w : float
        Speeds in m/s and rad/s by which the base may exceed the commands: a tenth of the limits.
    brake, aw : float
        Decelerations in m/s^2 and rad/s^2 that any base must reach: half of the limits.
    """

    asked: float
    patience: float
    frozen: float
    v: float
    w: float
    brake: float
    aw: float

    @classmethod
    def of(cls, robot: Robot) -> Thresholds:
        """Derive the thresholds from the description of a robot."""
        limits = robot.limits
        return cls(
            asked=0.04 * limits.v,
            patience=0.2 + 3.0 * robot.motor_time_constant,
            frozen=0.15,
            v=_TENTH * limits.v,
            w=_TENTH * limits.w,
            brake=0.5 * limits.brake,
            aw=0.5 * limits.aw,
        )


class MotionWatch:
    """Compares odometry with the commands sent.

    Four contradictions are faults:

    * the pose does not change although the velocity is not zero: odometry is frozen;
    * there is no motion although it is commanded: the wheels are blocked, or odometry froze at standstill;
    * there is less than a quarter of the commanded motion: the base is weak, or odometry shows too little;
    * the base moves faster than any command.

    If odometry is so slow that the robot is commanded to stand between two messages (below 6.7 Hz with the
    default `odom_timeout`), a base that reacts late looks like odometry that froze at standstill. Such frozen
    odometry is not always detected then; the robot moves by centimetres meanwhile.

    Parameters
    ----------
    robot : Robot
        Its limits, track and lag of the motors.
    latency : float
        Time in s from the stamp of a state until the command for it moves the base.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self.bounds = Thresholds.of(robot)
        self._limits, self._arm = robot.limits, robot.track / 2.0
        self._latency = latency
        self.reset()

    def reset(self) -> None:
        """Forget all states and commands, as when a goal begins: earlier commands are unknown."""
        self._sent: deque[tuple[float, Command]] = deque()
        self._last: tuple[float, RobotState] | None = None
        self._heard = -math.inf
        self._expected = STOP
        self._unanswered = _Stretch()
        self._weak = _Stretch()
        self._unasked = _Stretch()
        self._frozen = _Stretch()
        self._poses: deque[tuple[float, RobotState]] = deque()
        self._bands: tuple[_Band, _Band] | None = None

    def sent(self, time: float, command: Command) -> None:
        """Record a command sent in response to the state of `time` (s)."""
        acts = time + self._latency
        while self._sent and self._sent[-1][0] >= acts:
            self._sent.pop()
        self._sent.append((acts, command))

    def fault(self, time: float, robot: RobotState, now: float) -> str | None:
        """Process a state from odometry with its stamp `time` (s), received at the real time `now` (s).

        Returns
        -------
        str or None
            A sentence on the fault; None if the base moves as commanded.
        """
        last, self._last = self._last, (time, robot)
        heard, self._heard = self._heard, now
        if last is None or self._bands is None or time <= last[0]:
            self._bands = _Band.around(robot.v), _Band.around(robot.w)
            return None
        before, elapsed = last[1], time - last[0]
        dt = min(elapsed, _LONGEST_GAP)
        command = self._weakest(last[0], time)
        by_pose = self._speed_by_pose(before, robot, elapsed)
        return (
            self._contradiction(time, robot, _Span(dt, heard, now))
            or self._silence(before, robot, by_pose, command, _Span(elapsed, heard, now))
            or self._excess(time, robot, elapsed, _Span(dt, heard, now))
        )

    def _contradiction(self, time: float, robot: RobotState, span: _Span) -> str | None:
        """Return the fault if the pose does not change although the velocity is not zero.

        Poses are compared over `_WINDOW` s: between two successive messages jitter looks like motion.
        """
        self._poses.append((time, robot))
        while len(self._poses) > 1 and self._poses[1][0] <= time - _WINDOW + _ROUNDING:
            self._poses.popleft()
        then, before = self._poses[0]
        states, count = [state for _, state in self._poses], len(self._poses)
        said = self._wheel(sum(state.v for state in states) / count, sum(state.w for state in states) / count)
        by_pose = self._speed_by_pose(before, robot, time - then) if time > then else math.inf
        frozen = said >= self.bounds.asked and by_pose < _TENTH * said
        if not self._frozen.lasts(frozen, span, self.bounds.frozen - _WINDOW):
            return None
        return _frozen_pose(robot, _WINDOW + self._frozen.seconds)

    def _silence(
        self, before: RobotState, robot: RobotState, by_pose: float, command: Command, span: _Span
    ) -> str | None:
        """Return the fault if the base does not follow commands, or hardly does.

        A base whose velocity changes follows them, even near zero: a weak one is nearly still for a while
        when it changes from backward to forward.
        """
        dt = span.seconds
        self._expected = ramped(self._expected, command, dt, self._limits)
        wanted = self._wheel(self._expected.v, self._expected.w)
        asked = self._wheel(command.v, command.w) >= self.bounds.asked
        shown = min(self._wheel(robot.v, robot.w), by_pose)
        changed = self._wheel(robot.v - before.v, robot.w - before.w)
        gained = _QUARTER * self._wheel(self._limits.a * dt, self._limits.aw * dt)
        steady = asked and changed < gained
        weak = steady and wanted >= _QUARTER * self._limits.v and shown < _QUARTER * wanted
        weak = weak and dt <= _LONGEST_GAP + _ROUNDING  # over longer gaps the ramp lags behind too far
        too_weak = self._weak.lasts(weak, span, self.bounds.patience)
        if not self._unanswered.lasts(steady and shown < _TENTH * wanted, span, self.bounds.patience):
            return self._weak_base(shown, wanted) if too_weak else None
        if self._wheel(robot.v, robot.w) >= self.bounds.asked:
            return _frozen_pose(robot, self._unanswered.seconds)
        return (
            f"the base does not move: commanded to {command.v:.2f} m/s and {command.w:.2f} rad/s, odometry "
            f"has shown no motion for {self._unanswered.seconds:.2f} s: blocked wheels, motors off, or "
            "frozen odometry"
        )

    def _weak_base(self, shown: float, wanted: float) -> str:
        return (
            f"the base hardly moves: its wheels were commanded to {wanted:.2f} m/s, odometry has shown less "
            f"than a quarter of that for {self._weak.seconds:.2f} s, now {shown:.2f} m/s: slipping wheels, "
            "or odometry that shows too little"
        )

    def _excess(self, time: float, robot: RobotState, elapsed: float, span: _Span) -> str | None:
        """Return the fault if the base moves faster than all commands, including coasting."""
        assert self._bands is not None
        commands = self._recent(time - elapsed)
        v, w = self._bands
        v.follow([command.v for command in commands], self.bounds.brake * elapsed)
        w.follow([command.w for command in commands], self.bounds.aw * elapsed)
        beyond = v.beyond(robot.v, self.bounds.v) or w.beyond(robot.w, self.bounds.w)
        if not self._unasked.lasts(beyond, span, self.bounds.patience):
            return None
        last = commands[-1] if commands else STOP
        return (
            f"the base moves although it was not commanded to: odometry shows {robot.v:.2f} m/s and "
            f"{robot.w:.2f} rad/s, the last command was {last.v:.2f} m/s and {last.w:.2f} rad/s"
        )

    def _weakest(self, since: float, time: float) -> Command:
        """Return the slowest command in effect between two times in s.

        It may be a command to stand, sent between two messages that are far apart.
        """
        at_first = next((sent for acts, sent in reversed(self._sent) if acts <= since + _ROUNDING), STOP)
        later = [sent for acts, sent in self._sent if since + _ROUNDING < acts <= time]
        return min([at_first, *later], key=lambda command: self._wheel(command.v, command.w))

    def _recent(self, time: float) -> list[Command]:
        """Return the commands, oldest first, that may still act at `time` (s); forget older ones."""
        while len(self._sent) > 1 and self._sent[1][0] < time - self.bounds.patience:
            self._sent.popleft()
        return [command for _, command in self._sent]

    def _speed_by_pose(self, before: RobotState, robot: RobotState, elapsed: float) -> float:
        """Return the speed in m/s of the faster wheel, from the difference of two poses."""
        way = before.pose.distance(robot.pose)
        turn = wrap_angle(robot.pose.yaw - before.pose.yaw)
        return self._wheel(way / elapsed, turn / elapsed)

    def _wheel(self, v: float, w: float) -> float:
        """Return the absolute speed in m/s of the faster wheel."""
        return abs(v) + abs(w) * self._arm


def _frozen_pose(robot: RobotState, seconds: float) -> str:
    return (
        f"odometry is frozen: it says that the robot moves at {robot.v:.2f} m/s and {robot.w:.2f} rad/s, "
        f"but its pose has stood still for {seconds:.2f} s"
    )


@dataclass(frozen=True, slots=True)
class _Span:
    """The time between two states: seconds that count by the stamps; real times in s of both arrivals."""

    seconds: float
    began: float
    ended: float


class _Stretch:
    """How long a condition has held without a break, by the stamps and in real time."""

    def __init__(self) -> None:
        self.seconds, self._since = 0.0, math.inf

    def lasts(self, so: bool, span: _Span, longest: float) -> bool:
        """Add a span in which the condition held or not; return whether it has held for `longest` s."""
        if not so:
            self.seconds, self._since = 0.0, math.inf
            return False
        self._since = min(self._since, span.began)
        self.seconds += span.seconds
        return self.seconds >= longest - _ROUNDING and span.ended - self._since >= _SHORTEST_WAIT - _ROUNDING


class _Band:
    """The speeds that commands explain: from 0 to the commands, widened while the base still brakes."""

    def __init__(self, low: float, high: float) -> None:
        self._low, self._high = low, high

    @classmethod
    def around(cls, speed: float) -> _Band:
        """Return the band of a base first seen at `speed`."""
        return cls(min(0.0, speed), max(0.0, speed))

    def follow(self, targets: list[float], braked: float) -> None:
        """Update the band from the commands in effect and the speed change that braking has had time for."""
        self._low = min(0.0, *targets, self._low + braked)
        self._high = max(0.0, *targets, self._high - braked)

    def beyond(self, speed: float, margin: float) -> bool:
        """Return whether `speed` lies outside the band by more than `margin`."""
        return speed < self._low - margin or speed > self._high + margin
