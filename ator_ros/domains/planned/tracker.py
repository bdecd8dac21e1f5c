"""Trajectory tracking with feedback (Kanayama et al. 1990) and time scaling for weak bases."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ator_ros.bases.differential.response import ramped
from ator_ros.bases.differential.robot import DifferentialRobot
from ator_ros.bases.differential.trajectory import Trajectory
from ator_ros.geometry import Pose
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, RobotState, World

_LEAST_LAG_SHARE = 0.8  # of the described acceleration: least one at which a lag is measured
_FOLLOWS = 0.8  # share of the set speed's change below which a base is weak
_LEAST = 3  # ticks with a measured lag, before which the described one is used
# s above the described lag; at the Pioneer as described the estimate is 0.005 s more
_SURPRISE = 0.03
_MOST = 0.2  # s, greatest lag


class LagEstimator:
    """Estimates the first-order lag of a base's motors.

    It is a least-squares fit to speeds below rising set speeds. Set speeds are those of a base as
    described, without a lag. A base that accelerates too slowly is weak; its lag is not estimated.
    """

    def __init__(self, robot: DifferentialRobot) -> None:
        self._robot = robot
        self._last: World | None = None
        self._set = STOP
        self._short = 0.0
        self._gained = 0.0
        self._count = 0

    @property
    def seconds(self) -> float:
        """Time constant in s: the described one unless the estimate is much greater."""
        described = self._robot.motor_time_constant
        if self._count < _LEAST or self._short < (described + _SURPRISE) * self._gained:
            return described
        return min(self._short / self._gained, _MOST)

    def update(self, world: World, command: Command) -> None:
        """Process the state after a tick in which the base followed `command`."""
        last = self._last
        before = self._set
        self._last = world
        if last is None or world.time <= last.time:
            self._set = Command(world.robot.vx, world.robot.w)
            return
        passed = world.time - last.time
        self._set = ramped(
            before,
            command,
            passed,
            self._robot.limits,
            self._robot.stop,
        )
        was = abs(last.robot.vx)
        now = abs(world.robot.vx)
        asked = (abs(self._set.vx) - abs(before.vx)) / passed
        gained = (now - was) / passed
        if asked >= _LEAST_LAG_SHARE * self._robot.limits.a and gained >= _FOLLOWS * asked:
            short = 0.5 * (abs(self._set.vx) + abs(before.vx) - now - was)
            self._short += short * gained
            self._gained += gained * gained
            self._count += 1


DISTURBED_DISTANCE = 0.12
"""Distance in m from the plan beyond which it is made again."""
DISTURBED_HEADING = 0.35
"""Angle in rad from the plan beyond which it is made again."""
_ROUNDING = 1e-6  # s: greatest error of sums of ticks
_LONGEST_WAIT = 1.0  # s for the start of a robot whose computer plans slowly; then it is stuck
_SHORT = 0.5  # s; in a shorter plan a robot may hardly move, so that its start is not noticed
_SEEN_LATE = 0.02  # s by which a robot has the speeds of its plan late
# m/s^2 and rad/s^2: times the square of the preview, the deviation from which on the plan's time
# slows down. For the Pioneer that is 0.028 m and 0.063 rad, where its deviation as described is
# 0.0114 and 0.033 at most; for the Pioneer LX 0.2 and 0.47, where it is 0.12 and 0.11.
_BEHIND = 5.7
_TURNED_OFF = 12.9
_STRETCH = 0.125  # m above this deviation at which the time would stop
_TURN_STRETCH = 0.3  # rad
# control periods; states that are farther apart, three times in a row, have a lower rate
_RARE = 1.5
_LEAST_RATE = 0.3  # s of the plan in 1 s


class Tracker:
    """Steers a robot along a trajectory.

    The time of the trajectory passes more slowly while the robot falls behind, as when the base is
    weaker than its description: so it stays on the planned path (time scaling, Dahl and Nielsen
    1990).

    Parameters
    ----------
    robot : DifferentialRobot
        The robot, as described.
    trajectory : Trajectory
        The plan.
    start_time : float
        Start of the trajectory in s of the world's time.
    waits : bool
        Whether the trajectory starts later if the robot does.
    reserve : float
        Deceleration in m/s^2 of the base beyond that of the trajectory; infinite if a robot that
        overshoots can drive back.
    """

    GAIN_ALONG = 2.0  # m/s per m behind
    GAIN_HEADING = 3.0  # rad/s per rad
    # Turn rate per lateral deviation, in rad/s per m: it falls with speed so that the loop's
    # damping stays above one half, and is 0 at rest, where turning corrects nothing.
    GAIN_ACROSS = 12.0
    ACROSS_BANDWIDTH = 6.0  # greatest product of that gain and the speed, in rad/s^2
    SLOW = 0.1  # m/s below which the gain falls to 0
    # Below this angular acceleration, or above this lag, the loop has to be slower to be stable.
    BRISK_TURNING = 4.0  # rad/s^2
    BRISK_LAG = 0.14  # s

    def __init__(
        self,
        robot: DifferentialRobot,
        trajectory: Trajectory,
        start_time: float,
        *,
        waits: bool = False,
        reserve: float = math.inf,
    ) -> None:
        self._reserve = reserve
        self.trajectory = trajectory
        self._start = self._created = self._last_time = start_time
        self._rate = 1.0
        first = trajectory.at(0.0)
        still = RobotState(first.pose, first.vx, first.w).is_still
        self._waits = waits and still and trajectory.duration > _SHORT
        self._weak = math.sqrt(robot.limits.aw / self.BRISK_TURNING)
        self._robot = robot
        self._lag = LagEstimator(robot)
        self._command = STOP
        self._gaps = deque([0.0] * 3, maxlen=3)  # between the last states, s
        self._period = CONTROL_PERIOD
        self._set_preview(robot.motor_time_constant)
        self._usual = self._preview

    def _set_preview(self, lag: float) -> None:
        """Set the preview and the pace of the loop for a lag of the motors in s."""
        # The speed of a command is reached after the ramp of a period and the lag of the motors.
        self._preview = 0.8 * self._period + lag
        self._pace = min(1.0, self._weak, self.BRISK_LAG / self._preview)

    def keep_time(self, world: World) -> None:
        """Advance the plan's time to the state of this tick, as fast as the robot follows."""
        passed = world.time - self._last_time
        self._last_time = world.time
        self._gaps.append(passed)
        rare = min(self._gaps) > _RARE * CONTROL_PERIOD
        self._period = min(self._gaps) if rare else CONTROL_PERIOD
        self._wait_for_start(world)
        self._rate = 1.0
        if not self._waits:
            error = self.deviation(world)
            planned = self.trajectory.at(self.elapsed(world))
            behind = error.x * float(np.sign(planned.vx)) - _BEHIND * self._usual**2
            turned_off = abs(error.yaw) - _TURNED_OFF * self._usual**2
            slower = 1.0 - max(0.0, behind / _STRETCH, turned_off / _TURN_STRETCH)
            self._rate = max(_LEAST_RATE, slower)
        self._start += (1.0 - self._rate) * passed
        self._lag.update(world, self._command)
        self._set_preview(self._lag.seconds)

    def _wait_for_start(self, world: World) -> None:
        """Start the plan's time when the robot starts moving, which is late after long planning."""
        if not self._waits:
            return
        patient = world.time - self._created < _LONGEST_WAIT
        self._waits = patient and world.robot.is_still
        if self._waits:
            self._start = world.time
        # A moving robot started whole periods ago: states may have been missed.
        most = max(1, round(self.elapsed(world) / CONTROL_PERIOD))
        if self._waits or not patient or most == 1:
            return

        def error(ticks: int) -> float:
            planned = self.trajectory.at(ticks * CONTROL_PERIOD - _SEEN_LATE)
            turn_change = abs(planned.w - world.robot.w)
            change = abs(planned.vx - world.robot.vx) + self._robot.track / 2.0 * turn_change
            # Just after a start the speed differs most; a meter counts as much as a meter per
            # second.
            return change + planned.pose.distance(world.robot.pose)

        self._start = world.time - min(range(1, most + 1), key=error) * CONTROL_PERIOD

    def left(self, world: World) -> float:
        """Return the time in s to the end of the trajectory; not positive afterwards."""
        return self.trajectory.duration - self.elapsed(world) - _ROUNDING

    def disturbed(self, world: World) -> bool:
        """Return whether the robot is too far from the plan to follow it."""
        deviation = self.deviation(world)
        far = math.hypot(deviation.x, deviation.y) > DISTURBED_DISTANCE
        return far or abs(deviation.yaw) > DISTURBED_HEADING

    def elapsed(self, world: World) -> float:
        """Return the time in s since the trajectory started."""
        return world.time - self._start

    def deviation(self, world: World) -> Pose:
        """Return the planned pose relative to the robot."""
        return world.robot.pose.relative(self.trajectory.at(self.elapsed(world)).pose)

    def command(self, world: World) -> Command:
        """Return the next velocity command."""
        error = self.deviation(world)
        ahead = self.trajectory.at(self.elapsed(world) + self._rate * self._preview)
        planned_v = self._rate * ahead.vx
        planned_w = self._rate * ahead.w
        catching_up = self.GAIN_ALONG * error.x
        behind = error.x if planned_v >= 0.0 else -error.x
        if behind > 0.0:  # the reserve brakes again what catching up gains
            most = math.sqrt(2.0 * self._reserve * behind)
            catching_up = math.copysign(min(abs(catching_up), most), catching_up)
        v = planned_v * math.cos(error.yaw) + catching_up
        turning = self._pace * self.GAIN_HEADING * math.sin(error.yaw)
        w = planned_w + self._across(planned_v) * error.y + turning
        bound = self._robot.limits
        v = max(-bound.backward, min(bound.v, v))
        self._command = Command(v, max(-bound.w, min(bound.w, w)))
        return self._command

    def _across(self, v: float) -> float:
        speed = max(abs(v), self.SLOW)
        gain = self._pace * self._pace * min(self.GAIN_ACROSS, self.ACROSS_BANDWIDTH / speed)
        return math.copysign(gain, v) * min(1.0, abs(v) / self.SLOW)
