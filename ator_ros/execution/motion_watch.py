"""Detection of bases that do not move as commanded, by odometry (without ROS; both clocks are passed in)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from ator_ros.execution.spans import LONGEST_GAP, ROUNDING, Span, Stretch
from ator_ros.geometry import wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.robot.ramp import ramped
from ator_ros.world.state import STOP, Command, RobotState

_TENTH = 0.1
_QUARTER = 0.25
_WINDOW = 0.1  # s over which the motion of the pose is judged


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Thresholds above which motion that contradicts the commands is a fault, derived from the robot.

    Attributes
    ----------
    asked : float
        Speed of the faster wheel in m/s from which a command must be answered: 4 % of the greatest speed. The
        dead zone of a base lies below.
    patience : float
        Time in s without an answer, or with motion that was not commanded: 0.2 s and three time constants of
        the motors. With the time that it takes to brake it stays below half a second.
    frozen : float
        Time in s in which the pose may contradict the velocity: three messages at 20 Hz.
    v, w : float
        Speeds in m/s and rad/s by which the base may exceed the commands: a tenth of the limits.
    brake, aw : float
        Decelerations in m/s^2 and rad/s^2 that a slow base must reach: half of the limits.
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
    """Compares odometry with the commands that were sent.

    Four contradictions are faults:

    - frozen pose: the pose does not change although the velocity is not zero;
    - no motion: blocked wheels, or odometry that froze while the robot stood;
    - too little motion, less than a quarter: wrong odometry, or a weak base;
    - uncommanded motion: another program steers the base, or it does not stop.

    With odometry below 6.7 Hz (at the default `odom_timeout`) the robot is commanded to stand between two
    messages. Then a late base and frozen odometry look alike. Some frozen odometry is not noticed, and the
    robot moves by centimetres meanwhile.

    Parameters
    ----------
    robot : Robot
        Limits, track and lag of the motors.
    latency : float
        Time in s from the stamp of a state until the command that answers it moves the base.
    """

    def __init__(self, robot: Robot, latency: float) -> None:
        self.bounds = Thresholds.of(robot)
        self._limits, self._stop, self._arm = robot.limits, robot.stop, robot.track / 2.0
        self._latency = latency
        self.reset()

    def reset(self) -> None:
        """Forget the past, as when a goal begins: earlier commands to the base are unknown."""
        self._sent: deque[tuple[float, Command]] = deque()
        self._last: tuple[float, RobotState] | None = None
        self._heard = -math.inf
        self._answered: float | None = None
        self._expected = STOP
        self._unanswered = Stretch()
        self._weak = Stretch()
        self._unasked = Stretch()
        self._frozen = Stretch()
        self._poses: deque[tuple[float, RobotState]] = deque()
        self._bands: tuple[_Band, _Band] | None = None

    def sent(self, time: float, command: Command, now: float = -math.inf) -> None:
        """Note a command that was sent as the answer to a state of `time` (s).

        `now` is the real time in s at which it was sent, where that may be later than the state was heard.
        """
        self._answered = now if self._answered is None else self._answered
        acts = time + self._latency
        while self._sent and self._sent[-1][0] >= acts:
            self._sent.pop()
        self._sent.append((acts, command))

    def fault(self, time: float, robot: RobotState, now: float) -> str | None:
        """Take a state of the robot as odometry tells it, at `time` s by its stamp and `now` s of real time.

        Returns
        -------
        str or None
            What is wrong, in words; None if the base moves as commanded.
        """
        last, self._last = self._last, (time, robot)
        heard, self._heard = self._heard, now
        answered, self._answered = self._answered, None
        if last is None or self._bands is None or time <= last[0]:
            self._bands = _Band.around(robot.v), _Band.around(robot.w)
            return None
        before, elapsed = last[1], time - last[0]
        dt = min(elapsed, LONGEST_GAP)
        command = self._weakest(last[0], time)
        return (
            self._contradiction(time, robot, Span(dt, heard, now))
            or self._silence(before, robot, command, Span(elapsed, heard, now).since(answered))
            or self._excess(time, robot, elapsed, Span(dt, heard, now))
        )

    def _contradiction(self, time: float, robot: RobotState, span: Span) -> str | None:
        """Return a fault if the pose is constant while odometry reports motion.

        The pose is compared with one several messages ago, because between consecutive messages jitter
        looks like motion.
        """
        self._poses.append((time, robot))
        while len(self._poses) > 1 and self._poses[1][0] <= time - _WINDOW + ROUNDING:
            self._poses.popleft()
        then, before = self._poses[0]
        states, count = [state for _, state in self._poses], len(self._poses)
        mean = self._wheel(sum(state.v for state in states) / count, sum(state.w for state in states) / count)
        said = min(mean, *(self._wheel(state.v, state.w) for state in states))  # blocked wheels say 0
        by_pose = self._speed_by_pose(before, robot, time - then) if time > then else math.inf
        frozen = said >= self.bounds.asked and by_pose < _TENTH * said
        if not self._frozen.lasts(frozen, span, self.bounds.frozen - _WINDOW):
            return None
        return _frozen_pose(robot, _WINDOW + self._frozen.seconds)

    def _silence(self, before: RobotState, robot: RobotState, command: Command, span: Span) -> str | None:
        """Return the fault where the base does not answer commands, or hardly does.

        A base whose velocity changes answers them, though it may be passing through zero: a weak one stands
        nearly still for a while when it goes from backward to forward.
        """
        dt = span.seconds
        self._expected = ramped(self._expected, command, dt, self._limits, self._stop)
        wanted = self._wheel(self._expected.v, self._expected.w)
        asked = self._wheel(command.v, command.w) >= self.bounds.asked
        shown = self._shown(before, robot, span)
        changed = self._wheel(robot.v - before.v, robot.w - before.w)
        gained = _QUARTER * self._wheel(self._limits.a * dt, self._limits.aw * dt)
        steady = asked and changed < gained
        weak = steady and wanted >= _QUARTER * self._limits.v and shown < _QUARTER * wanted
        weak = weak and not span.long  # the mean over more lags behind too far
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

    def _shown(self, before: RobotState, robot: RobotState, span: Span) -> float:
        """Return the speed in m/s of the faster wheel that odometry shows, both by pose and by velocity.

        In a long gap a base that hears nothing stands by itself, after it has moved: either is an answer.
        """
        told = self._wheel(robot.v, robot.w)
        if not span.long:
            return min(told, self._speed_by_pose(before, robot, span.elapsed))
        return max(told, self._speed_by_pose(before, robot, min(span.elapsed, self.bounds.patience)))

    def _weak_base(self, shown: float, wanted: float) -> str:
        return (
            f"the base hardly moves: its wheels were commanded to {wanted:.2f} m/s, odometry has shown less "
            f"than a quarter of that for {self._weak.seconds:.2f} s, now {shown:.2f} m/s: slipping wheels, "
            "or odometry that shows too little"
        )

    def _excess(self, time: float, robot: RobotState, elapsed: float, span: Span) -> str | None:
        """Return the fault where the base moves beyond all commands, coasting included."""
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
        """Return the slowest command that moved the base between two times in s.

        Between messages that are far apart the robot is commanded to stand.
        """
        at_first = next((sent for acts, sent in reversed(self._sent) if acts <= since + ROUNDING), STOP)
        later = [sent for acts, sent in self._sent if since + ROUNDING < acts <= time]
        return min([at_first, *later], key=lambda command: self._wheel(command.v, command.w))

    def _recent(self, time: float) -> list[Command]:
        """Return the commands, the oldest first, that `time` s may still show, and forget older ones."""
        while len(self._sent) > 1 and self._sent[1][0] < time - self.bounds.patience:
            self._sent.popleft()
        return [command for _, command in self._sent]

    def _speed_by_pose(self, before: RobotState, robot: RobotState, elapsed: float) -> float:
        """Return the speed in m/s of the faster wheel, as the difference of two poses tells it."""
        way = before.pose.distance(robot.pose)
        turn = wrap_angle(robot.pose.yaw - before.pose.yaw)
        return self._wheel(way / elapsed, turn / elapsed)

    def _wheel(self, v: float, w: float) -> float:
        """Return the speed in m/s of the faster wheel, without its sign."""
        return abs(v) + abs(w) * self._arm


def _frozen_pose(robot: RobotState, seconds: float) -> str:
    return (
        f"odometry is frozen: it says that the robot moves at {robot.v:.2f} m/s and {robot.w:.2f} rad/s, "
        f"but its pose has stood still for {seconds:.2f} s"
    )


class _Band:
    """The speeds that the commands explain: between 0 and the commands, or where the base still brakes."""

    def __init__(self, low: float, high: float) -> None:
        self._low, self._high = low, high

    @classmethod
    def around(cls, speed: float) -> _Band:
        """Return the band of a base that was found at `speed`."""
        return cls(min(0.0, speed), max(0.0, speed))

    def follow(self, targets: list[float], braked: float) -> None:
        """Take the commands that may still show, and by how much speeds beyond them have had to fall."""
        self._low = min(0.0, *targets, self._low + braked)
        self._high = max(0.0, *targets, self._high - braked)

    def beyond(self, speed: float, margin: float) -> bool:
        """Return whether `speed` lies outside by more than `margin`."""
        return speed < self._low - margin or speed > self._high + margin
