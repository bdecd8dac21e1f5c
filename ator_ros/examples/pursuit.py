"""A second driver's control law: regulated pure pursuit behind a rotation shim, as Nav2 documents them.

On a map it follows the path of a planner, `navfn`. Without a map the path is straight, but for the bias of
a planner on a grid. Like the first law it is independent of ator_ros and of ROS.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ator_ros.examples.navfn import Grid, NavFn
from ator_ros.examples.rotate_drive_rotate import ENDED, Phase, RotateDriveRotate, State


@dataclass(frozen=True)
class Tuning:
    """Parameters with Nav2's names and defaults, except where a comment says otherwise; SI units, radians."""

    desired_linear_vel: float = 0.6  # as in the recorded drives of Nav2
    lookahead_dist: float = 0.6
    regulated_linear_scaling_min_radius: float = 0.9
    regulated_linear_scaling_min_speed: float = 0.25
    approach_velocity_scaling_dist: float = 0.6
    min_approach_linear_velocity: float = 0.05
    rotate_to_heading_angular_vel: float = 1.2  # as in the recorded drives
    max_angular_accel: float = 2.0  # read from the recorded commands
    angular_dist_threshold: float = 0.785  # above this angle to the path a rotation in place begins
    angular_disengage_threshold: float = 0.3925  # up to this angle to the path it ends
    xy_goal_tolerance: float = 0.15  # as in the recorded drives
    yaw_goal_tolerance: float = 0.15  # as in the recorded drives
    controller_frequency: float = 20.0
    required_movement_radius: float = 0.5
    movement_time_allowance: float = 10.0  # the drive fails if the robot stays in that radius for longer
    grid_bias: float = 0.05  # greatest angle between path and straight line; fitted to 104 recorded drives


class Pursuit:
    """Drives to one goal, x, y (m) and yaw (rad), on a planned path or straight; one instance for each."""

    tuning = Tuning()

    def __init__(self, goal: tuple[float, float, float], planner: NavFn | None = None) -> None:
        self._planner = planner
        self._path: _Path | None = None
        self.phase = Phase.FOLLOWING
        self.distance = math.inf
        self._goal = goal
        self._w = 0.0
        self._moved_at = State(-math.inf, math.inf, math.inf, 0.0)

    def step(self, state: State) -> tuple[float, float]:
        """Return the velocities (m/s, rad/s) for a state; `phase` shows whether the drive has ended."""
        self.distance = math.hypot(self._goal[0] - state.x, self._goal[1] - state.y)
        v = 0.0
        if self._planner is not None and self._path is None and self.phase not in ENDED:
            points = self._planner.path((state.x, state.y), self._goal[:2])
            self._path = None if points is None else _Path(points)
            self.phase = Phase.MISSED if points is None else self.phase
        if self._path is not None:
            self._path.follow(state.x, state.y)
        self.phase = self._next_phase(state)
        if self.phase is Phase.FOLLOWING:
            v, self._w = self._follow(self._angle_to_path(state))
        elif self.phase is Phase.ROTATING_TO_PATH:
            self._w = self._rotate(self._angle_to_path(state))
        elif self.phase is Phase.ROTATING_TO_GOAL:
            self._w = self._rotate(self._angle_to_goal(state))
        else:
            self._w = 0.0
        return v, self._w

    def _next_phase(self, state: State) -> Phase:
        tuning = self.tuning
        if self.phase in ENDED:
            return self.phase
        if self.phase is Phase.SETTLING:
            return Phase.ARRIVED  # Nav2's navigator reports the result a tick after its controller
        if not self._progresses(state):
            return Phase.TOO_LONG
        if self.phase is Phase.ROTATING_TO_GOAL or self.distance <= tuning.xy_goal_tolerance:
            close = abs(self._angle_to_goal(state)) <= tuning.yaw_goal_tolerance
            return Phase.SETTLING if close else Phase.ROTATING_TO_GOAL
        rotating = self.phase is Phase.ROTATING_TO_PATH
        threshold = tuning.angular_disengage_threshold if rotating else tuning.angular_dist_threshold
        far_off = abs(self._angle_to_path(state)) > threshold
        return Phase.ROTATING_TO_PATH if far_off else Phase.FOLLOWING

    def _progresses(self, state: State) -> bool:
        """Return whether the robot has moved far enough within the allowed time."""
        tuning, since = self.tuning, self._moved_at
        if math.hypot(state.x - since.x, state.y - since.y) > tuning.required_movement_radius:
            self._moved_at = state
        return state.time - self._moved_at.time <= tuning.movement_time_allowance

    def _angle_to_goal(self, state: State) -> float:
        return math.remainder(self._goal[2] - state.yaw, math.tau)

    def _angle_to_path(self, state: State) -> float:
        """Return the angle from the robot's heading to the lookahead point.

        NavFn plans on the grid of the map: its path leaves the robot closer to an axis of the grid than the
        straight line to the goal does.
        """
        if self._path is not None:
            x, y = self._path.ahead(state.x, state.y, self.tuning.lookahead_dist)
            return math.remainder(math.atan2(y - state.y, x - state.x) - state.yaw, math.tau)
        direction = math.atan2(self._goal[1] - state.y, self._goal[0] - state.x)
        if self.distance > self.tuning.lookahead_dist:
            direction -= self.tuning.grid_bias * math.sin(4.0 * direction)
        return math.remainder(direction - state.yaw, math.tau)

    def _follow(self, angle: float) -> tuple[float, float]:
        """Return the velocities toward the lookahead point: slower in sharp curves and near the goal."""
        tuning = self.tuning
        curvature = 2.0 * math.sin(angle) / min(self.distance, tuning.lookahead_dist)
        sharpness = abs(curvature) * tuning.regulated_linear_scaling_min_radius
        v = tuning.desired_linear_vel / max(1.0, sharpness)
        v = max(v, tuning.regulated_linear_scaling_min_speed)
        remaining = self.distance if self._path is None else self._path.remaining
        approach = v * remaining / tuning.approach_velocity_scaling_dist
        v = min(v, max(approach, tuning.min_approach_linear_velocity))
        return v, v * curvature

    def _rotate(self, angle: float) -> float:
        """Return the turn rate of a rotation in place, accelerated from the command before."""
        change = self.tuning.max_angular_accel / self.tuning.controller_frequency
        wanted = math.copysign(self.tuning.rotate_to_heading_angular_vel, angle)
        return max(self._w - change, min(self._w + change, wanted))


class _Path:
    """A planned path, and how far along it the robot is."""

    def __init__(self, points: Grid) -> None:
        self._points = points
        steps = np.hypot(*np.diff(points, axis=0).T)
        self._left = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
        self._near = 0

    @property
    def remaining(self) -> float:
        """Length in m from the point next to the robot to the goal."""
        return float(self._left[self._near])

    def follow(self, x: float, y: float) -> None:
        """Take the point next to (x, y) m, up to 1 m ahead of the last one."""
        last = self._near + np.searchsorted(-self._left[self._near :], 1.0 - self._left[self._near], "right")
        away = np.hypot(*(self._points[self._near : last] - (x, y)).T)
        self._near += int(np.argmin(away))

    def ahead(self, x: float, y: float, lookahead: float) -> tuple[float, float]:
        """Return the first point from there on that is `lookahead` m away from (x, y), or the goal."""
        away = np.hypot(*(self._points[self._near :] - (x, y)).T)
        far = np.flatnonzero(away >= lookahead)
        x, y = self._points[self._near + far[0] if len(far) else -1]
        return float(x), float(y)


Law = RotateDriveRotate | Pursuit
"""A control law, for the server and for the simulation without ROS."""
