"""goToPose in soccer: approach the ball without knocking it away, and drive around it elsewhere."""

from __future__ import annotations

import dataclasses
import math

from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.bases.differential.manoeuvre import Manoeuvre
from ator_ros.bases.differential.paths import Ends
from ator_ros.domains.planned.free_paths import (
    Obstacles,
    distance_to_clear,
    free_entries,
    free_exits,
    run_exits,
)
from ator_ros.domains.planned.go_to_pose import GoToPose, tries_at
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.domains.soccer.thresholds import approach_run, caught_within
from ator_ros.geometry import Pose
from ator_ros.tops.objects import is_at_front
from ator_ros.world.state import ObjectState, RobotState, World

_MOVED = 0.04  # m that a ball may move, or seem to, before the approach is planned again
# speeds at the end of the straight drive away from a ball, as shares of the limit
_LEAVING = (0.0, 0.3)


class GoToPoseOrBall(GoToPose):
    """Drives to a pose of the axle, or of the hold if the goal is a ball.

    A ball at the goal is approached in a straight run to where it will come to rest (paper:
    goToBall). A ball elsewhere is an obstacle. A robot that starts too near the ball first drives
    straight away from it, usually backward.
    """

    def setup(self) -> None:
        """Compute the tables of drives and approaches from rest to rest; see `Action.setup`."""
        super().setup()
        run_exits(self.plan_limits, 0.0, approach_run(self.robot))

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
            there = Pose(rest.x, rest.y, self.goal.pose.yaw)
            self.goal = dataclasses.replace(self.goal, pose=there)
        self._planned_for = rest
        return super().plan(world)

    def arriving(self, start: RobotState, speed: float) -> Manoeuvre:
        """Plan to arrive at `speed` (m/s); see `GoToPose.arriving`."""
        run = approach_run(self.robot) if self._approach else 0.0
        limits = self.plan_limits
        exits = run_exits(limits, speed, run) if run else free_exits(limits, speed)
        radius = self.robot.scene.radius(BALL) if self._planned_for else 0.0
        obstacles = Obstacles(self._planned_for, radius, run)
        away = distance_to_clear(start.pose, self.target(), obstacles, self.robot)
        if away == 0.0:
            try:
                return self.direct(start, speed, exits, obstacles)
            except ActionError:  # there may be too little room before the ball to approach it
                outside = dataclasses.replace(obstacles, run=0.0)
                away = distance_to_clear(start.pose, self.target(), outside, self.robot)
                if away == 0.0:
                    raise
        tries = tries_at(speed) if speed == 0.0 else tries_at(speed) // 2
        return self._leaving_ball(start, exits, obstacles, away, tries)

    def _leaving_ball(
        self,
        start: RobotState,
        exits: Ends,
        obstacles: Obstacles,
        away: float,
        tries: int,
    ) -> Manoeuvre:
        """Plan a straight drive by `away` (m, signed) clear of the ball, and on to the goal."""
        limits = self.plan_limits
        clear = start.pose.ahead(away)
        best: Manoeuvre | None = None
        failure: ActionError | None = None
        for share in _LEAVING:
            speed = math.copysign(share * limits.v, away)
            if speed * speed > 2.0 * min(limits.a, limits.brake) * abs(away):
                continue
            entries = free_entries(limits, speed, stops=False)
            try:
                found = self.fastest(clear, entries, exits, obstacles, tries)
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
        rest = self._rest(world)
        planned = self._planned_for
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
