"""Control law of `pursuit_server`: Nav2's regulated pure pursuit controller with a rotation shim.

On a map it follows a path of `NavFn`; without a map the path is straight. Like `RotateDriveRotate`
it is independent of ator_ros and of ROS. Source: the configuration guide of Nav2 (docs.nav2.org).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros_examples.navfn import Grid, NavFn
from ator_ros_examples.rotate_drive_rotate import ENDED, Phase, RotateDriveRotate, State


@dataclass(frozen=True)
class Tuning:
    """Parameters with Nav2's names, SI units, and Nav2's defaults unless a comment says otherwise.

    They are those of the regulated pure pursuit controller, the rotation shim controller (from
    `angular_dist_threshold` on, without acceleration to `rotate_to_heading_angular_vel`), the
    simple goal checker, the simple progress checker and the controller server.
    """

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
    # the drive fails if the robot stays in that radius for longer
    movement_time_allowance: float = 10.0
    # not Nav2's: greatest angle of a path to the straight line, fitted to 104 drives
    grid_bias: float = 0.05
    # not Nav2's: a newer goal behind a robot that drives, above this angle to the path, holds it up
    # for that time in s, as behind Nav2 a recovery does
    sharp_turn: float = 2.1
    held_up: float = 2.5
    # of the default tree of NavigateThroughPoses: s between plans; poses nearer than that in m are
    # removed before
    replanning_period: float = 3.0
    passed_radius: float = 0.7
    # not Nav2's: a corner of the path is cut by that distance in m
    corner_dist: float = 0.25


class Pursuit:
    """Drives to one goal, x, y (m) and yaw (rad), on a planned path or straight."""

    tuning = Tuning()

    def __init__(
        self,
        goal: tuple[float, float, float],
        planner: NavFn | None = None,
    ) -> None:
        self._planner = planner
        self._path: _Path | None = None
        self.phase = Phase.FOLLOWING
        self.distance = math.inf
        self._goal = goal
        self._w = 0.0
        self._interrupts = False
        self._held_until = -math.inf  # s
        self._moved_at = State(
            -math.inf,
            math.inf,
            math.inf,
            0.0,
        )

    def take_over(
        self,
        former: Law,  # noqa: ARG002
    ) -> None:
        """Take over from a former goal while the robot drives."""
        self._interrupts = True

    def step(self, state: State) -> tuple[float, float]:
        """Return the velocities (m/s, rad/s) for a state; `phase` is in `ENDED` after the end."""
        self.distance = self._distance_left(state)
        v = 0.0
        if self._planner is not None and self._path is None and self.phase not in ENDED:
            points = self._planner((state.x, state.y), self._goal[:2])
            self._path = None if points is None else _Path(points)
            self.phase = Phase.MISSED if points is None else self.phase
        if self._path is not None:
            self._path.follow(state.x, state.y)
        if self._interrupts and abs(self._angle_to_path(state)) > self.tuning.sharp_turn:
            self._held_until = state.time + self.tuning.held_up
        self._interrupts = False
        if state.time < self._held_until:
            return 0.0, 0.0
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

    def _distance_left(self, state: State) -> float:
        return math.hypot(self._goal[0] - state.x, self._goal[1] - state.y)

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
        threshold = tuning.angular_dist_threshold
        if self.phase is Phase.ROTATING_TO_PATH:
            threshold = tuning.angular_disengage_threshold
        far_off = abs(self._angle_to_path(state)) > threshold
        return Phase.ROTATING_TO_PATH if far_off else Phase.FOLLOWING

    def _progresses(self, state: State) -> bool:
        """Return whether the robot has moved far enough within the allowed time."""
        tuning = self.tuning
        since = self._moved_at
        if math.hypot(state.x - since.x, state.y - since.y) > tuning.required_movement_radius:
            self._moved_at = state
        return state.time - self._moved_at.time <= tuning.movement_time_allowance

    def _angle_to_goal(self, state: State) -> float:
        return math.remainder(self._goal[2] - state.yaw, math.tau)

    def _angle_to_path(self, state: State) -> float:
        """Return the angle (rad) from the robot's heading to the lookahead point."""
        if self._path is not None:
            x, y = self._path.ahead(state.x, state.y, self.tuning.lookahead_dist)
            return math.remainder(math.atan2(y - state.y, x - state.x) - state.yaw, math.tau)
        direction = math.atan2(self._goal[1] - state.y, self._goal[0] - state.x)
        # NavFn's paths begin nearer to an axis of the grid
        if self.distance > self.tuning.lookahead_dist:
            direction -= self.tuning.grid_bias * math.sin(4.0 * direction)
        return math.remainder(direction - state.yaw, math.tau)

    def _follow(self, angle: float) -> tuple[float, float]:
        """Return velocities toward the lookahead point: slower in curves and near the goal."""
        tuning = self.tuning
        curvature = 2.0 * math.sin(angle) / min(self.distance, tuning.lookahead_dist)
        sharpness = abs(curvature) * tuning.regulated_linear_scaling_min_radius
        v = tuning.desired_linear_vel / max(1.0, sharpness)
        v = max(v, tuning.regulated_linear_scaling_min_speed)
        approach = v * self._approach_distance() / tuning.approach_velocity_scaling_dist
        v = min(v, max(approach, tuning.min_approach_linear_velocity))
        return v, v * curvature

    def _approach_distance(self) -> float:
        """Return the length in m of the path that is left."""
        return self.distance if self._path is None else self._path.remaining

    def _rotate(self, angle: float) -> float:
        """Return the turn rate of a rotation in place, accelerated from the previous command."""
        change = self.tuning.max_angular_accel / self.tuning.controller_frequency
        wanted = math.copysign(self.tuning.rotate_to_heading_angular_vel, angle)
        return max(self._w - change, min(self._w + change, wanted))


class PursuitThrough(Pursuit):
    """Drives through poses to the last one, as NavigateThroughPoses does with its default tree.

    A path leads from the robot through all poses that are left. Every 3 s those are removed that
    are near, and the path is planned again. So the robot turns back to a pose that it has passed,
    if it has left it by more than `passed_radius` until then.

    A newer list of poses changes the next plan: until then the robot follows the former path.
    """

    def __init__(
        self,
        goals: Sequence[tuple[float, float, float]],
        planner: NavFn | None = None,
    ) -> None:
        super().__init__(goals[-1])
        self._plan = planner or _straight
        self._left = list(goals)
        self._planned_at = -math.inf
        self._parts: list[_Path] = []  # of the path, after the one that the robot follows

    def take_over(
        self,
        former: Law,
    ) -> None:
        """Take over from a former goal while the robot drives, on its path if it has several."""
        if not isinstance(former, PursuitThrough):
            super().take_over(former)
            return
        self._planned_at = former._planned_at
        self._path = former._path
        self._parts = former._parts
        self.phase = former.phase
        self._w = former._w

    def step(self, state: State) -> tuple[float, float]:
        """Return the velocities (m/s, rad/s) for a state; `phase` is in `ENDED` after the end."""
        if state.time - self._planned_at >= self.tuning.replanning_period:
            self._planned_at = state.time
            self._plan_again(state)
        elif self._parts and super()._approach_distance() <= self.tuning.corner_dist:
            self._path = self._parts.pop(0)
        return super().step(state)

    def _plan_again(self, state: State) -> None:
        radius = self.tuning.passed_radius
        here = (state.x, state.y)
        while len(self._left) > 1 and math.dist(here, self._left[0][:2]) <= radius:
            del self._left[0]
        places = [here, *(goal[:2] for goal in self._left)]
        parts = [self._plan(start, end) for start, end in itertools.pairwise(places)]
        self._parts = [_Path(part) for part in parts if part is not None]
        if len(self._parts) < len(parts):
            self.phase = Phase.MISSED
        else:
            self._path = self._parts.pop(0)

    def _distance_left(self, state: State) -> float:
        return math.inf if self._parts else super()._distance_left(state)

    def _approach_distance(self) -> float:
        return math.inf if self._parts else super()._approach_distance()


def _straight(start: tuple[float, float], end: tuple[float, float]) -> Grid:
    """Return points on a straight line, at most 5 cm apart, shape (n, 2)."""
    count = 2 + math.ceil(math.dist(start, end) / 0.05)
    return np.linspace(start, end, count)


class _Path:
    """A planned path, and the robot's progress on it."""

    def __init__(self, points: Grid) -> None:
        self._points = points
        steps = np.hypot(*np.diff(points, axis=0).T)
        self._left = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
        self._near = 0

    @property
    def remaining(self) -> float:
        """Length in m from the point next to the robot to the goal."""
        return float(self._left[self._near])

    def follow(
        self,
        x: float,
        y: float,
    ) -> None:
        """Advance to the point next to (x, y) m, up to 1 m ahead of the last one."""
        rest = self._left[self._near :]
        last = self._near + np.searchsorted(-rest, 1.0 - rest[0], "right")
        away = np.hypot(*(self._points[self._near : last] - (x, y)).T)
        self._near += int(np.argmin(away))

    def ahead(
        self,
        x: float,
        y: float,
        lookahead: float,
    ) -> tuple[float, float]:
        """Return the first point of the rest that is `lookahead` m from (x, y), or the goal."""
        rest = self._points[self._near :]
        far = np.flatnonzero(np.hypot(*(rest - (x, y)).T) >= lookahead)
        x, y = rest[far[0] if len(far) else -1].tolist()
        return x, y


Law = RotateDriveRotate | Pursuit
