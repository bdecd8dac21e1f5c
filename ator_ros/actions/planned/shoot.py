"""shoot: send the ball into the goal by motion alone, since the robot has no kicker."""

from __future__ import annotations

import itertools
import math

from ator_ros.actions.base import ActionError, Goal, Status, Step, finished
from ator_ros.actions.planned.clearance import Obstacles
from ator_ros.actions.planned.holding import entry_sides, release_sides
from ator_ros.actions.planned.holding_action import HoldingAction
from ator_ros.actions.planned.manoeuvre import Manoeuvre
from ator_ros.actions.planned.planner import fastest
from ator_ros.geometry import Pose
from ator_ros.world import World

# Distance in m before the goal line, along the heading, at which the robot brakes; the ball rolls twice that.
RELEASE = 0.33
_AIMS = (-0.4, 0.0, 0.4)  # shares of half the goal's width
_HEADINGS = tuple(math.radians(angle) for angle in (-35.0, 0.0, 35.0))
_PATIENCE = 2.0
_TRIES = 40  # for each way to release: where the posts block so many, another release is better


class Shoot(HoldingAction):
    """Runs at the goal with the ball and brakes: the ball rolls on, over the line.

    The goal's position is the middle of the goal's mouth; its yaw and speed are not used, since what
    counts is the ball.
    """

    name = "shoot"
    verb = "running up"

    def start(self, world: World, goal: Goal) -> None:
        """Plan the run-up; see `Action.start`."""
        self._released: float | None = None
        super().start(world, Goal(goal.pose, 0.0, goal.point))

    def plan(self, world: World) -> Manoeuvre:
        """Plan the fastest of a few run-ups that end in front of the goal at full speed."""
        robot, limits, start = self.robot, self.plan_limits, world.robot.pose
        entries = entry_sides(robot, limits, round(max(0.0, world.robot.v), 3))
        exits = release_sides(robot, limits)
        plans = []
        for release in self._releases():
            try:
                plans.append(
                    fastest(
                        robot,
                        start,
                        release,
                        entries,
                        exits,
                        limits,
                        Obstacles(),
                        forward_only=True,
                        tries=_TRIES,
                    )
                )
            except ActionError:
                continue
        if not plans:
            raise ActionError(f"{self.name}: expected room for a run-up to the goal, found none")
        return min(plans, key=lambda plan: plan.duration)

    def step(self, world: World) -> Step:
        """Follow the run-up, then brake until the ball is in the goal."""
        if self._in_goal(world):
            return finished(Status.SUCCEEDED, "the ball is in the goal")
        if self._released is None:
            return super().step(world)
        ball = world.ball
        over = world.time - self._released > _PATIENCE or ball is None or ball.speed < 0.02
        if over:
            return finished(Status.FAILED, "the ball stopped before the goal")
        return finished(Status.RUNNING, "the ball is rolling")

    def arrive(self, world: World) -> Step:
        """Release the ball by braking as hard as the base can."""
        self._released = world.time
        return finished(Status.RUNNING, "released the ball")

    def _releases(self) -> list[Pose]:
        """Give poses of the axle at which the ball, let go, rolls into the goal."""
        x, y = self.goal.pose.x, self.goal.pose.y
        outward = 0.0 if x > 0.0 else math.pi
        half = self.robot.field.goal_width / 2.0
        poses = []
        for aim, heading in itertools.product(_AIMS, _HEADINGS):
            mouth = Pose(x, y + aim * half, outward + heading)
            poses.append(mouth.ahead(-RELEASE - self.robot.hold))
        return poses

    def _in_goal(self, world: World) -> bool:
        ball, goal = world.ball, self.goal.pose
        if ball is None:
            return False
        beyond = (ball.x - goal.x) * math.copysign(1.0, goal.x) > self.robot.ball.radius
        return beyond and abs(ball.y - goal.y) < self.robot.field.goal_width / 2.0
