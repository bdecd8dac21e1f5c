"""Control law of `drive_to_server`: rotate to the path, follow it, rotate to the goal's heading.

It has its own tolerances and rules, and is independent of ator_ros and of ROS. A simulation without
ROS executes the same law.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """Parameters in SI units; those that Nav2's controllers have, too, have their names."""

    v: float = 0.7  # speed forward
    v_reverse: float = 0.4  # speed backward
    a: float = 0.5  # acceleration
    brake: float = 0.4  # planned deceleration before the goal
    w_path: float = 1.2  # turn rate in place, to the path
    w_goal: float = 0.7  # turn rate in place, to the goal's heading
    aw: float = 1.6  # angular acceleration
    rotate_above: float = 0.7  # heading error above which the drive begins with a rotation in place
    aligned: float = 0.12  # heading error at which that rotation ends
    reverse_above: float = 2.1  # angle to the goal above which the robot drives backward
    lookahead_dist: float = 0.6
    pause: float = 0.6  # standstill after rotating to the path
    xy_goal_tolerance: float = 0.06  # within it the position is not corrected
    yaw_goal_tolerance: float = 0.08
    settle: float = 0.2  # standstill at the goal's heading before the result
    time_limit: float = 60.0  # time after which the drive fails


class Phase(enum.Enum):
    """Phase of a drive."""

    ROTATING_TO_PATH = "rotating to the path"
    PAUSING = "pausing before the path"
    FOLLOWING = "following the path"
    ROTATING_TO_GOAL = "rotating to the goal's heading"
    SETTLING = "settling"
    ARRIVED = "arrived"
    MISSED = "missed the goal"
    TOO_LONG = "took too long"


ENDED = (Phase.ARRIVED, Phase.MISSED, Phase.TOO_LONG)
# ratio of the distance to the goal at the end of the path to its tolerance: the drive failed
_MISSED = 3.0
_TURN_GAIN = 3.0  # 1/s
_FOLLOW_GAIN = 2.0  # 1/s
_SLOWEST = 0.06  # m/s
# Below these speeds the robot counts as standing.
_STANDING = 0.02  # m/s
_STANDING_TURN = 0.04  # rad/s


@dataclass(frozen=True)
class State:
    """State of the robot: time in s, pose (m, rad), velocities (m/s, rad/s)."""

    time: float
    x: float
    y: float
    yaw: float
    v: float = 0.0
    w: float = 0.0


class RotateDriveRotate:
    """Drives to one goal, x, y (m) and yaw (rad)."""

    tuning = Tuning()

    def __init__(self, goal: tuple[float, float, float]) -> None:
        self.phase = Phase.ROTATING_TO_PATH
        self.distance = math.inf
        self._goal = goal
        self._began: float | None = None
        self._since = self._last = 0.0
        self._start = (0.0, 0.0)
        self._sign = 1.0
        self._v = self._w = 0.0

    def step(self, state: State) -> tuple[float, float]:
        """Return the velocities (m/s, rad/s) for a state; `phase` is in `ENDED` after the end."""
        self.distance = math.hypot(self._goal[0] - state.x, self._goal[1] - state.y)
        if self._began is None:
            self._begin(state)
        if state.time - (self._began or 0.0) > self.tuning.time_limit:
            self._enter(Phase.TOO_LONG, state)
        v, w = self._wanted(state)
        dt = max(0.0, state.time - self._last)
        self._last = state.time
        self._v = _toward(
            self._v,
            v,
            self.tuning.a * dt,
            slowing=math.inf,
        )
        self._w = _toward(
            self._w,
            w,
            self.tuning.aw * dt,
            slowing=self.tuning.aw * dt,
        )
        if self.phase in ENDED:
            self._v = self._w = 0.0
        return self._v, self._w

    def _begin(self, state: State) -> None:
        """Choose between forward and backward, and whether to rotate in place first."""
        self._began = self._last = state.time
        self._start = (state.x, state.y)
        if self.distance < self.tuning.xy_goal_tolerance:
            self._enter(Phase.ROTATING_TO_GOAL, state)
            return
        self._sign = -1.0 if abs(self._bearing(state)) > self.tuning.reverse_above else 1.0
        if abs(self._bearing(state)) <= self.tuning.rotate_above:
            self._enter(Phase.FOLLOWING, state)

    def _wanted(self, state: State) -> tuple[float, float]:
        """Return the target velocities, before accelerations are limited."""
        tuning = self.tuning
        if self.phase is Phase.ROTATING_TO_PATH:
            error = self._bearing(state)
            if abs(error) > tuning.aligned:
                return 0.0, self._turning(error, tuning.w_path)
            self._enter(Phase.PAUSING, state)
        if self.phase is Phase.PAUSING:
            if state.time - self._since < tuning.pause:
                return 0.0, 0.0
            self._enter(Phase.FOLLOWING, state)
        if self.phase is Phase.FOLLOWING:
            left = self._left(state)
            if self.distance > tuning.xy_goal_tolerance and left > 0.0:
                return self._following(state, left)
            missed = self.distance > _MISSED * tuning.xy_goal_tolerance
            self._enter(Phase.MISSED if missed else Phase.ROTATING_TO_GOAL, state)
        if self.phase in (Phase.ROTATING_TO_GOAL, Phase.SETTLING):
            return self._at_goal(state)
        return 0.0, 0.0

    def _at_goal(self, state: State) -> tuple[float, float]:
        """Rotate to the goal's heading, then wait until the robot has stood there for a while."""
        error = _wrapped(self._goal[2] - state.yaw)
        if self.phase is Phase.ROTATING_TO_GOAL:
            if abs(error) > self.tuning.yaw_goal_tolerance:
                return 0.0, self._turning(error, self.tuning.w_goal)
            self._enter(Phase.SETTLING, state)
        if abs(state.v) > _STANDING or abs(state.w) > _STANDING_TURN:
            self._since = state.time
        if state.time - self._since >= self.tuning.settle:
            stands_right = abs(error) <= 2.0 * self.tuning.yaw_goal_tolerance
            self._enter(Phase.ARRIVED if stands_right else Phase.ROTATING_TO_GOAL, state)
        return 0.0, 0.0

    def _following(
        self,
        state: State,
        left: float,
    ) -> tuple[float, float]:
        """Steer to a point on the path ahead, slower at large heading errors and near the goal."""
        tuning = self.tuning
        x, y = self._ahead(left)
        error = self._heading_error(state, x, y)
        most = tuning.v if self._sign > 0.0 else tuning.v_reverse
        toward = max(0.15, math.cos(error)) if abs(error) < math.pi / 2.0 else 0.0
        before_goal = math.sqrt(2.0 * tuning.brake * left)
        speed = max(_SLOWEST, min(most * toward, before_goal))
        turn = max(-tuning.w_path, min(tuning.w_path, _FOLLOW_GAIN * error))
        return self._sign * speed, turn

    def _ahead(self, left: float) -> tuple[float, float]:
        """Return the point of the path, a straight line, `lookahead_dist` ahead of the robot."""
        x0, y0 = self._start
        x1, y1, _ = self._goal
        length = math.hypot(x1 - x0, y1 - y0)
        share = (max(0.0, left - self.tuning.lookahead_dist)) / length
        return x1 - share * (x1 - x0), y1 - share * (y1 - y0)

    def _left(self, state: State) -> float:
        """Return the remaining distance along the path in m."""
        x0, y0 = self._start
        x1, y1, _ = self._goal
        length = math.hypot(x1 - x0, y1 - y0)
        return ((x1 - state.x) * (x1 - x0) + (y1 - state.y) * (y1 - y0)) / length

    def _bearing(self, state: State) -> float:
        """Return the heading error to the goal in rad."""
        return self._heading_error(state, self._goal[0], self._goal[1])

    def _heading_error(
        self,
        state: State,
        x: float,
        y: float,
    ) -> float:
        """Return the turn (rad) until (x, y) lies ahead, or behind in a drive backward."""
        flipped = 0.0 if self._sign > 0.0 else math.pi
        return _wrapped(math.atan2(y - state.y, x - state.x) + flipped - state.yaw)

    def _turning(
        self,
        error: float,
        most: float,
    ) -> float:
        """Return a turn rate from which the robot can stop at the error 0."""
        stopping = math.sqrt(2.0 * 0.8 * self.tuning.aw * abs(error))
        return math.copysign(min(most, _TURN_GAIN * abs(error), stopping), error)

    def _enter(
        self,
        phase: Phase,
        state: State,
    ) -> None:
        self.phase = phase
        self._since = state.time


def _toward(
    value: float,
    target: float,
    most: float,
    *,
    slowing: float,
) -> float:
    """Return `value` moved toward `target` by at most `most`, or `slowing` where it slows down."""
    step = slowing if abs(target) < abs(value) and target * value >= 0.0 else most
    return value + max(-step, min(step, target - value))


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)
