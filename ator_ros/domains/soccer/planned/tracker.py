"""Follows a trajectory: its velocities ahead of time, and feedback (Kanayama et al., ICRA 1990)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from ator_ros.domains.soccer.planned.reactions import LagSeen, Reactions, StrengthSeen
from ator_ros.geometry import Pose
from ator_ros.motion.trajectory import Trajectory
from ator_ros.robot.description import Robot
from ator_ros.world.state import CONTROL_PERIOD, Command, RobotState, World

DISTURBED_DISTANCE = 0.12  # m from the plan
DISTURBED_HEADING = 0.35  # rad
_ROUNDING = 1e-6  # s by which sums of ticks may be off
_LONGEST_WAIT = 1.0  # s for the robot's start, on a computer that plans slowly
_SHORT = 0.5  # s; a robot may hardly move in a plan that takes less
_SEEN_LATE = 0.02  # s after which the speeds of a plan are those of a robot that follows it
# m/s^2 and rad/s^2: times the square of its preview, how far from its plan a robot as described may be.
# The Pioneer is behind by 0.0114 m and off by 0.033 rad at most, where it may be by 0.028 and 0.063, the
# Pioneer LX by 0.12 and 0.11 (0.2 and 0.47). Farther from the plan the plan's time slows down.
_BEHIND, _TURNED_OFF = 5.7, 12.9
_STRETCH, _TURN_STRETCH = 0.125, 0.3  # m and rad beyond these at which it would stop
_RARE = 1.5  # control periods; states that are farther apart, three times in a row, come at a lower rate
_LEAST_RATE = 0.3  # s of the plan in 1 s


@dataclass(frozen=True, slots=True)
class Deviation:
    """The planned pose seen from the robot: m ahead, m to the left, rad counter-clockwise."""

    along: float
    across: float
    heading: float

    @property
    def distance(self) -> float:
        """Distance from the plan in m."""
        return math.hypot(self.along, self.across)


class Tracker:
    """Steers a robot along a trajectory.

    The time of the trajectory passes more slowly where the robot falls behind, since the base is weaker than
    its description: so it stays on the way that was planned (trajectory time scaling, Dahl and Nielsen 1990).
    Once the base has shown how weak it is, the rest is slowed down ahead, where it would ask for too much.

    Parameters
    ----------
    robot : Robot
        Lag of the base, and the bounds of the commands.
    trajectory : Trajectory
        What to follow.
    start_time : float
        When the trajectory starts, in s of the world's time.
    strength : StrengthSeen
        The accelerations that the base has shown, and shows.
    waits : bool
        Whether the trajectory starts later where the robot does.
    reserve : float
        Deceleration in m/s^2 that the base has beyond that of the trajectory; infinite where a robot that
        runs past a place can come back.
    """

    GAIN_ALONG = 2.0
    GAIN_HEADING = 3.0
    # Turn rate per lateral deviation: falls with speed so that the loop's damping stays above one half,
    # and fades out where the robot hardly moves and turning corrects nothing.
    GAIN_ACROSS = 12.0
    ACROSS_BANDWIDTH = 6.0
    SLOW = 0.1
    # These gains swing a robot that turns less briskly, or whose motors lag more: its loop has to be slower.
    BRISK_TURNING = 4.0  # rad/s^2
    BRISK_LAG = 0.14  # s

    def __init__(
        self,
        robot: Robot,
        trajectory: Trajectory,
        start_time: float,
        strength: StrengthSeen,
        *,
        waits: bool = False,
        reserve: float = math.inf,
    ) -> None:
        self._limits, self._lever, self._reserve = robot.limits, robot.track / 2.0, reserve
        self.trajectory = trajectory
        self._start = self._made = self._seen = start_time
        self._rate = 1.0
        first = trajectory.at(0.0)
        still = RobotState(first.pose, first.v, first.w).is_still
        self._waits = waits and still and trajectory.duration > _SHORT
        self._weak = math.sqrt(robot.limits.aw / self.BRISK_TURNING)
        self._reactions, self._lag, self._strength = Reactions(robot), LagSeen(robot), strength
        self._able = strength.described
        self._gaps = deque([0.0] * 3, maxlen=3)  # between the last states, s
        self._period = CONTROL_PERIOD
        self._slow_down(start_time)
        self._foresee(robot.motor_time_constant)
        self._usual = self._preview

    def _foresee(self, lag: float) -> None:
        """Look ahead by the lag of the motors, in s, and follow the more slowly the longer it is."""
        # A command is reached after a period's ramp, most of which it is late, and the motors lag behind.
        self._preview = 0.8 * self._period + lag
        self._pace = min(1.0, self._weak, self.BRISK_LAG / self._preview)

    def keep_time(self, world: World) -> None:
        """Let the plan's time pass until the state of this tick, as fast as the robot follows."""
        passed, self._seen = world.time - self._seen, world.time
        self._gaps.append(passed)
        rare = min(self._gaps) > _RARE * CONTROL_PERIOD
        self._period = min(self._gaps) if rare else CONTROL_PERIOD
        self._wait_for_start(world)
        self._rate = 1.0 if self._waits else self._rate_for(world)
        self._start += (1.0 - self._rate) * passed
        reaction = self._reactions.see(world)
        if reaction is not None:
            self._strength.see(reaction)
            if not self._strength.weak:  # else its speed is behind since it gains less
                self._lag.see(reaction)
        self._foresee(self._lag.seconds)
        self._slow_down(world.time)

    def _slow_down(self, time: float) -> None:
        """Follow the rest of the plan only as fast as the base has shown that it can, from `time` (s) on."""
        able, passed = self._strength.limits, time - self._start
        if able != self._able and passed < self.trajectory.duration:
            self.trajectory, self._start = self.trajectory.rest(passed, able), time
            self._able = able

    def _rate_for(self, world: World) -> float:
        """Return how fast the plan's time passes: 1, or less for a robot that falls behind."""
        error, planned = self.deviation(world), self.trajectory.at(self.elapsed(world))
        behind = error.along * float(np.sign(planned.v)) - _BEHIND * self._usual**2
        turned_off = abs(error.heading) - _TURNED_OFF * self._usual**2
        return max(_LEAST_RATE, 1.0 - max(0.0, behind / _STRETCH, turned_off / _TURN_STRETCH))

    def _wait_for_start(self, world: World) -> None:
        """Start the plan's clock when the robot starts moving: after long planning its command is late."""
        if not self._waits:
            return
        patient = world.time - self._made < _LONGEST_WAIT
        self._waits = patient and world.robot.is_still
        if self._waits:
            self._start = world.time
        elif patient:
            self._start = self._begun(world)

    def _begun(self, world: World) -> float:
        """Return when (s) a moving robot started, whole periods ago: states may have been missed."""
        most = max(1, round(self.elapsed(world) / CONTROL_PERIOD))
        if most == 1:
            return self._start

        def error(ticks: int) -> float:
            planned = self.trajectory.at(ticks * CONTROL_PERIOD - _SEEN_LATE)
            change = abs(planned.v - world.robot.v) + self._lever * abs(planned.w - world.robot.w)
            # Just after a start the speed tells most; a metre counts as much as a metre per second.
            return change + planned.pose.distance(world.robot.pose)

        return world.time - min(range(1, most + 1), key=error) * CONTROL_PERIOD

    def left(self, world: World) -> float:
        """Return the time in s to the end of the trajectory; not positive afterwards."""
        return self.trajectory.duration - self.elapsed(world) - _ROUNDING

    def disturbed(self, world: World) -> bool:
        """Return whether the robot is too far from the plan to follow it."""
        deviation = self.deviation(world)
        return deviation.distance > DISTURBED_DISTANCE or abs(deviation.heading) > DISTURBED_HEADING

    def elapsed(self, world: World) -> float:
        """Return the time in s since the trajectory started."""
        return world.time - self._start

    def deviation(self, world: World) -> Deviation:
        """Return the robot's present deviation from the plan."""
        planned = self.trajectory.at(self.elapsed(world)).pose
        seen: Pose = world.robot.pose.relative(planned)
        return Deviation(seen.x, seen.y, seen.yaw)

    def command(self, world: World) -> Command:
        """Return the next velocity command."""
        error = self.deviation(world)
        ahead = self.trajectory.at(self.elapsed(world) + self._rate * self._preview)
        planned_v, planned_w = self._rate * ahead.v, self._rate * ahead.w
        v = planned_v * math.cos(error.heading) + self._catching_up(error.along, forward=planned_v >= 0.0)
        turning = self._pace * self.GAIN_HEADING * math.sin(error.heading)
        w = planned_w + self._across(planned_v) * error.across + turning
        bound = self._limits
        command = Command(max(-bound.v, min(bound.v, v)), max(-bound.w, min(bound.w, w)))
        self._reactions.sent(command)
        return command

    def _catching_up(self, along: float, *, forward: bool) -> float:
        """Return the speed in m/s that is added to catch up: the reserve loses it again on the way."""
        speed, behind = self.GAIN_ALONG * along, along if forward else -along
        if behind <= 0.0:
            return speed
        return math.copysign(min(abs(speed), math.sqrt(2.0 * self._reserve * behind)), speed)

    def _across(self, v: float) -> float:
        speed = max(abs(v), self.SLOW)
        gain = self._pace * self._pace * min(self.GAIN_ACROSS, self.ACROSS_BANDWIDTH / speed)
        return math.copysign(gain, v) * min(1.0, abs(v) / self.SLOW)
