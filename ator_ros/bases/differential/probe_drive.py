"""A short drive that shows the response of a base: creeping, sprints to and fro, spins."""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean

from ator_ros.printable import ReadableError
from ator_ros.world.state import STOP, Command, RobotState

_CREEP_STEPS = 12
_CREEP = 0.01, 0.02  # m/s and rad/s by which creeping commands grow
_CREEP_TIME = 0.6  # s of each
_WINDOW = 0.4  # s over which a speed is judged
_LONGEST_PERIOD = 0.1  # s between two states of slow odometry
_STEADY = 0.02  # greatest change of a steady speed within the window, as a share of the speed
_RESOLUTION = 0.005  # m/s and rad/s; least such change
_SURELY_MOVING = 0.02, 0.04  # m/s and rad/s above which the base moves, whatever the noise
_TIMEOUT = 10.0  # s until a sprint ends although the speed is not steady: 1 m/s at 0.1 m/s^2
_STOP_TIMEOUT = 4.0  # s until a stop counts as reached, although noise looks like motion
_START = 1.5  # s within which the base must move
_SLOW = 0.3  # share of the speed that a sprint brakes to
_SHARE = 0.45  # share of the free space in which a sprint may gain speed


class DrivePart(enum.Enum):
    """A part of the drive."""

    CREEP_V = "creep"
    CREEP_W = "creep turning"
    SPRINT_V = "sprint"
    SPRINT_W = "spin"


class DriveError(ReadableError, ValueError):
    """A base that does not respond as expected; the message names command and motion, or remedy."""


@dataclass(frozen=True, slots=True)
class DriveSample:
    """A state of the robot and the command in response to it."""

    part: DrivePart
    time: float  # s; stamp of the state
    command: Command
    robot: RobotState


class ProbeDrive:
    """Returns the command for each state until the drive is over, and collects `samples`.

    Parameters
    ----------
    v, w : float
        Greatest commands in m/s and rad/s; above the limits of the base, so that these are reached.
    space : float
        Free distance ahead of the robot in m. It also needs half a meter behind it, and space to
        turn.
    backward : bool
        Whether the base drives backward; if not, it sprints forward only.
    """

    def __init__(self, *, v: float, w: float, space: float, backward: bool = True) -> None:
        self.samples: list[DriveSample] = []
        self._greatest = Command(v, w)
        self._space = space
        self._backward = backward
        self._commands = self._drive()
        self._states: deque[tuple[float, RobotState]] = deque()
        self._part = DrivePart.CREEP_V

    def command(self, time: float, robot: RobotState) -> Command | None:
        """Return the command for the state at `time` (s), None at the end.

        DriveError if nothing moves.
        """
        self._states.append((time, robot))
        while self._states[0][0] < time - _WINDOW - 1e-6:
            self._states.popleft()
        command = next(self._commands, None)
        if command is not None:
            self.samples.append(DriveSample(self._part, time, command, robot))
        return command

    # Each generator resumes after its `yield` with the next state.

    def _drive(self) -> Iterator[Command]:
        yield from self._creep(DrivePart.CREEP_V, Command(vx=_CREEP[0]))
        yield from self._creep(DrivePart.CREEP_W, Command(w=_CREEP[1]))
        for part, top in (
            (DrivePart.SPRINT_V, Command(vx=self._greatest.vx)),
            (DrivePart.SPRINT_W, Command(w=self._greatest.w)),
        ):
            for sign in (1.0, -1.0) if part is DrivePart.SPRINT_W or self._backward else (1.0,):
                self._part = part
                yield from self._sprint(Command(sign * top.vx, sign * top.w))
                yield from self._stand()

    def _creep(self, part: DrivePart, step: Command) -> Iterator[Command]:
        self._part = part
        for number in range(1, _CREEP_STEPS + 1):
            yield from self._hold(Command(number * step.vx, number * step.w), _CREEP_TIME)
        yield from self._stand()
        v = fmean(state.vx for _, state in self._states)
        w = fmean(state.w for _, state in self._states)
        if self._drifts and (abs(v) > _SURELY_MOVING[0] or abs(w) > _SURELY_MOVING[1]):
            raise DriveError(
                f"odometry: expected no speed {_STOP_TIMEOUT:g} s after the command to stop, got "
                f"v={v:.3f} m/s, w={w:.3f} rad/s; correct the bias of the gyro or of the encoders, "
                "or stop the base that drifts"
            )

    def _sprint(self, top: Command) -> Iterator[Command]:
        """Gain speed until it is steady or half of the space is used; brake to a part of it."""
        start = self._now.pose
        (began, _) = self._states[-1]
        while not self._steady and self._time - began < _TIMEOUT:
            if self._now.pose.distance(start) > _SHARE * self._space:
                break
            if self._time - began > _START and not self._moving:
                advice = "; if it never drives backward, set limits.v_back: 0 in --robot"
                raise DriveError(
                    f"the base does not move: expected motion within {_START:g} s of the command "
                    f"v={top.vx:g} m/s, w={top.w:g} rad/s{advice if top.vx < 0.0 else ''}"
                )
            yield top
        slow = Command(_SLOW * self._now.vx, _SLOW * self._now.w)
        slow = Command(w=slow.w) if top.vx == 0.0 else Command(vx=slow.vx)
        began = self._time
        while not (self._steady and self._time - began > _WINDOW) and self._time - began < _TIMEOUT:
            if self._now.pose.distance(start) > self._space:
                break
            yield slow

    def _stand(self) -> Iterator[Command]:
        began = self._time
        yield from self._hold(STOP, _WINDOW)
        while self._drifts and self._time - began < _STOP_TIMEOUT:
            yield STOP

    def _hold(self, command: Command, seconds: float) -> Iterator[Command]:
        began = self._time
        while self._time - began < seconds - 1e-6:
            yield command

    @property
    def _time(self) -> float:
        return self._states[-1][0]

    @property
    def _now(self) -> RobotState:
        return self._states[-1][1]

    @property
    def _drifts(self) -> bool:
        """Whether the base moves on any axis."""
        return abs(self._now.vx) > _SURELY_MOVING[0] or abs(self._now.w) > _SURELY_MOVING[1]

    @property
    def _moving(self) -> bool:
        return self._moves(self._speed(self._now))

    def _moves(self, speed: float) -> bool:
        """Return whether the axis of a sprint moves."""
        return abs(speed) > _SURELY_MOVING[self._part is DrivePart.SPRINT_W]

    def _speed(self, state: RobotState) -> float:
        """Return the speed of the axis of a sprint in m/s or rad/s."""
        return state.w if self._part is DrivePart.SPRINT_W else state.vx

    @property
    def _steady(self) -> bool:
        """Whether the axis moved for the whole window, at the same mean speed in both halves."""
        half = len(self._states) // 2
        # s; up to one period of odometry less than the window
        covered = self._time - self._states[0][0]
        if covered < _WINDOW - _LONGEST_PERIOD or not half:
            return False
        speeds = [self._speed(state) for _, state in self._states]
        before = fmean(speeds[:half])
        after = fmean(speeds[half:])
        # Of a base that has just started, the mean of the window is small, whatever it accelerates.
        if not all(map(self._moves, (speeds[0], before, speeds[half], speeds[-1]))):
            return False
        return abs(after - before) <= max(_STEADY * abs(after), _RESOLUTION)
