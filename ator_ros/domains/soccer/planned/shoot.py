"""shoot: send the ball into the goal by motion alone, since the robot has no kicker."""

from __future__ import annotations

import math
from contextlib import suppress

from ator_ros.actions.base import ActionError, Goal, Status, Step, finished
from ator_ros.domains.soccer.ball import BALL, ball_of
from ator_ros.domains.soccer.field import field_of, is_in_goal
from ator_ros.domains.soccer.planned.clearance import Obstacles
from ator_ros.domains.soccer.planned.holding import release_sides, run_up_sides
from ator_ros.domains.soccer.planned.holding_action import HoldingAction
from ator_ros.domains.soccer.planned.planner import fastest
from ator_ros.domains.soccer.planned.release import release_poses, rolling_time, scoring_time
from ator_ros.domains.soccer.planned.run_up import run_up
from ator_ros.motion.manoeuvre import Manoeuvre
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import ways_to_drive
from ator_ros.world.state import World

_PATIENCE = 2.0
_LARGE = math.radians(200.0)  # beyond which two turns may be better than one
_TRIES = 40  # for each way to release: where the posts block so many, another release is better


class Shoot(HoldingAction):
    """Drives at the goal with the ball and brakes: the ball rolls on over the line.

    The goal's position is the middle of the goal's mouth; its yaw and speed are not used, since what
    counts is the ball.
    """

    name = "shoot"
    verb = "running up"
    plans_in_motion = False  # toward the goal the way that this takes may be what a run-up lacks

    def setup(self) -> None:
        """Compute the tables of run-ups from rest; see `Action.setup`."""
        limits = self.plan_limits
        self.prepare(run_up_sides(self.robot, limits, 0.0), release_sides(self.robot, limits))

    def start(self, world: World, goal: Goal) -> None:
        """Plan the run-up; see `Action.start`."""
        self._released: float | None = None
        super().start(world, Goal(goal.pose, 0.0, goal.point))

    def plan(self, world: World) -> Planning[Manoeuvre]:
        """Plan the run-up that brings the ball behind the line first."""
        robot, limits, start = self.robot, self.plan_limits, world.robot.pose
        side = field_of(robot).side_of(self.goal.pose.x)
        mouth = self.goal.pose._replace(yaw=0.0 if side > 0 else math.pi)
        speed = round(max(0.0, world.robot.v), 3)
        entries = run_up_sides(robot, limits, speed)
        one_turn = yield from run_up(robot, start, mouth, entries, limits)
        if one_turn is not None and abs(one_turn.first) < _LARGE:
            return one_turn
        best, soonest = one_turn, math.inf
        if one_turn is not None:
            soonest = scoring_time(robot, mouth, one_turn)
            yield one_turn
        ways = yield from ways_to_drive(entries, release_sides(robot, limits), limits)
        for pose in release_poses(robot, mouth, limits):
            longest = soonest - rolling_time(robot, mouth, pose, limits.v)
            with suppress(ActionError):
                plan = yield from fastest(
                    robot, start, pose, ways, Obstacles(), forward_only=True, tries=_TRIES, longest=longest
                )
                time = scoring_time(robot, mouth, plan)
                if time < soonest:
                    best, soonest = plan, time
                    yield plan
        if best is None:
            raise ActionError(f"{self.name}: expected room for a run-up to the goal, found none")
        return best

    def step(self, world: World) -> Step:
        """Follow the run-up, then brake until the ball is in the goal."""
        ball, robot = ball_of(world), self.robot
        if ball and is_in_goal(ball, self.goal.pose, field_of(robot), robot.scene.radius(BALL)):
            return finished(Status.SUCCEEDED, "the ball is in the goal")
        if self._released is None:
            return super().step(world)
        over = world.time - self._released > _PATIENCE or ball is None or ball.rests
        if over:
            why = "the ball stopped before the goal"
            if self.check(world) is not None:
                return finished(Status.FAILED, why)
            self._released = None  # so short a push has left it in front
            return self.replan(world, why)
        return finished(Status.RUNNING, "the ball is rolling")

    def missed(self, world: World) -> str | None:  # noqa: ARG002
        """Return what is missing: where the ball is released the goal is not reached yet."""
        return "the ball is not released"

    def arrive(self, world: World) -> Step:
        """Release the ball by braking as hard as the base can."""
        self._released = world.time
        return finished(Status.RUNNING, "released the ball")
