"""goToPose: drive to a pose, or approach the ball without knocking it away."""

from __future__ import annotations

import dataclasses
import math

from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.bases.description import Robot
from ator_ros.bases.differential.description import differential
from ator_ros.bases.differential.manoeuvre import Manoeuvre
from ator_ros.bases.differential.paths import Ends
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.domains.soccer.planned.free_paths import (
    TRIES,
    Obstacles,
    distance_to_clear,
    fastest,
    free_entries,
    free_exits,
    run_exits,
    turn_on_spot,
)
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.domains.soccer.thresholds import approach_run, caught_within
from ator_ros.geometry import Pose
from ator_ros.tops.objects import is_at_front
from ator_ros.world.state import ObjectState, RobotState, World

_MOVED = 0.04  # m
# s: motors that lag more brake too late after catching up, and the robot returns for 3 s
_LAGGING = 0.05
# m from the goal within which a standing robot only turns; less than the tolerance
_TURNS_WITHIN = 0.04
# speeds at the end of the straight drive away from a ball, as shares of the limit
_LEAVING = (0.0, 0.3)
# paths to arrive at a speed that are checked in a tick, half as many to leave a ball
_TRIES_AT_SPEED = 1000
_SLOWER = (1.0, 0.75, 0.5)  # shares of the goal's speed that are tried one after the other, then 0


class GoToPose(PlannedAction):
    """Drives to a pose of the axle, or of the hold if the goal is a ball (paper: goToPose, goToBall).

    A ball at the goal is approached in a straight run to where it will come to rest. A ball
    elsewhere is an obstacle. A robot that starts too near the ball first drives straight away from
    it, usually backward. A base with `limits.v_back` 0 never drives backward.
    """

    name = "goToPose"
    verb = "driving"

    def __init__(self, robot: Robot) -> None:
        described = differential(robot)
        super().__init__(described, described.limits)
        self._forward_only = not described.limits.backward
        if described.motor_time_constant > _LAGGING:
            self.reserve = max(0.0, described.limits.brake - self.plan_limits.brake)

    def setup(self) -> None:
        """Compute the tables of drives and approaches from rest to rest; see `Action.setup`."""
        limits = self.plan_limits
        (
            free_entries(limits, 0.0),
            free_exits(limits, 0.0),
            run_exits(limits, 0.0, approach_run(self.robot)),
        )

    def start(self, world: World, goal: Goal) -> None:
        """Plan the path to `goal`; see `Action.start`."""
        rest = self._rest(world)
        near = 2.0 * caught_within(self.robot)
        at_goal = rest is not None and math.hypot(rest.x - goal.pose.x, rest.y - goal.pose.y) < near
        self._approach = self.counts_moved_goals = goal.point is Point.HOLD and at_goal
        super().start(world, goal)

    def plan(self, world: World) -> Manoeuvre:
        """Plan an approach or a plain drive; see `PlannedAction.plan`."""
        rest = self._rest(world)
        if self._approach and rest is not None:
            self.goal = dataclasses.replace(
                self.goal, pose=Pose(rest.x, rest.y, self.goal.pose.yaw)
            )
        self._planned_for = rest
        # A robot that has a plan keeps it if there is no path at the goal's speed.
        slower = _SLOWER if self._tracker is None and self.goal.speed else ()
        for share in slower:
            try:
                return self._arriving(world, rest, share * self.goal.speed)
            except ActionError:
                continue  # as when a weak robot has no room to gain speed
        return self._arriving(world, rest, 0.0 if slower else self.goal.speed)

    def _arriving(self, world: World, rest: ObjectState | None, speed: float) -> Manoeuvre:
        """Plan to arrive at `speed` (m/s); `rest` is where the ball comes to rest."""
        run, limits = approach_run(self.robot) if self._approach else 0.0, self.plan_limits
        exits = run_exits(limits, speed, run) if run else free_exits(limits, speed)
        obstacles = Obstacles(rest, run)
        start, goal = world.robot, self.target()
        away = distance_to_clear(start.pose, goal, obstacles, self.robot)
        found = None
        if away == 0.0:
            try:
                found = self._direct(start, goal, speed, exits, obstacles)
            except ActionError:  # there may be too little room before the ball to approach it
                outside = dataclasses.replace(obstacles, run=0.0)
                away = distance_to_clear(start.pose, goal, outside, self.robot)
                if away == 0.0:
                    raise
        if found is None:
            tries = TRIES if speed == 0.0 else _TRIES_AT_SPEED // 2
            found = self._leaving_ball(start, goal, exits, obstacles, away, tries)
        self._arrival_speed = speed
        return found

    def _direct(
        self, start: RobotState, goal: Pose, speed: float, exits: Ends, obstacles: Obstacles
    ) -> Manoeuvre:
        """Plan to arrive at `speed` (m/s) from a start that is clear of the ball."""
        limits, pose = self.plan_limits, start.pose
        stays = start.is_still and speed == 0.0 and not self._approach
        if stays and pose.distance(goal) < _TURNS_WITHIN:
            return turn_on_spot(self.robot, pose, goal.yaw, limits, obstacles)
        entries, tries = free_entries(limits, start.vx), TRIES if speed == 0.0 else _TRIES_AT_SPEED
        return self._fastest(pose, goal, entries, exits, obstacles, tries)

    def _fastest(
        self, start: Pose, goal: Pose, entries: Ends, exits: Ends, obstacles: Obstacles, tries: int
    ) -> Manoeuvre:
        return fastest(
            self.robot,
            start,
            goal,
            entries,
            exits,
            self.plan_limits,
            obstacles,
            forward_only=self._forward_only,
            tries=tries,
        )

    def _leaving_ball(
        self,
        start: RobotState,
        goal: Pose,
        exits: Ends,
        obstacles: Obstacles,
        away: float,
        tries: int,
    ) -> Manoeuvre:
        """Plan a straight drive by `away` (m, signed), which clears the ball, and on to `goal`."""
        limits, clear = self.plan_limits, start.pose.ahead(away)
        best: Manoeuvre | None = None
        failure: ActionError | None = None
        for share in _LEAVING:
            speed = math.copysign(share * limits.v, away)
            if speed * speed > 2.0 * min(limits.a, limits.brake) * abs(away):
                continue
            entries = free_entries(limits, speed, stops=False)
            try:
                found = self._fastest(clear, goal, entries, exits, obstacles, tries)
            except ActionError as error:
                failure = error
                continue
            entry = found.entry._replace(length=away, outer_speed=start.vx)
            found = dataclasses.replace(found, start=start.pose, entry=entry)
            if best is None or found.duration < best.duration:
                best = found
        if best is None:
            raise failure or ActionError("expected a path away from the ball, found none")
        return best

    def outdated(self, world: World) -> bool:
        """Return whether the ball has moved while it was still free."""
        rest, planned = self._rest(world), self._planned_for
        if rest is None or planned is None:
            return rest is not planned
        touching = is_at_front(world, self.robot, BALL)
        return not touching and math.hypot(rest.x - planned.x, rest.y - planned.y) > _MOVED

    def missed(self, world: World) -> str | None:
        """Return why the robot is not at the goal.

        None if it is, after an approach with the ball.
        """
        caught = not self._approach or self.robot.hold_offset(world, BALL) <= caught_within(
            self.robot
        )
        return super().missed(world) or (None if caught else "the ball is not in front")

    def _rest(self, world: World) -> ObjectState | None:
        """Return the ball where it will come to rest."""
        ball = ball_of(world)
        return None if ball is None else self.robot.scene.at_rest(BALL, ball)
