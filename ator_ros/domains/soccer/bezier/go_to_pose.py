"""goToPose: drive to a pose along a Bezier curve that is recomputed at every tick (paper, section 3)."""

from __future__ import annotations

import math
from typing import ClassVar

from ator_ros.actions.base import Action, Goal, Status, Step, finished
from ator_ros.domains.soccer.bezier.curve import CurveShape
from ator_ros.domains.soccer.bezier.driver import Driver, Style, check_goal, reached, straightens
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.domains.soccer.thresholds import ball_clearance
from ator_ros.geometry import FloatArray, Pose
from ator_ros.robot.description import Robot
from ator_ros.tops.objects import is_at_front
from ator_ros.world.state import Command, ObjectState, World

TO_POSE = Style(CurveShape(0.3, 0.05, 0.12, 0.25), 60.0, 2.2, 0.6)
TO_BALL = Style(CurveShape(0.25, 0.3, 0.12, 0.25), 60.0, 2.0, 0.6)

_AT_BALL = 0.2  # m between the ball and the hold of a robot at the goal
_BACKING = 0.3
"""Speed in m/s at which the robot backs off from a ball in its front."""
_STRAIGHTENING = 0.5  # rad that a robot may turn on the spot with the ball between its fins


class BezierGoToPose(Action):
    """Drive to a pose; where the goal is a ball, come from behind it and leave it in its place.

    Forward only, except to back off from a ball in front that is not at the goal. A goal with a speed is
    passed at that speed; one that was missed is driven at again.
    """

    name: ClassVar[str] = "goToPose"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._goal = Goal(Pose(0.0, 0.0, 0.0))

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_goal(goal, self.robot.limits.v, self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        ball = ball_of(world)
        self._to_ball = self._lies_at_goal(ball)
        self._leaves = not self._to_ball and is_at_front(world, self.robot, BALL)
        style = TO_BALL if self._to_ball else TO_POSE
        beside = ball if self._to_ball or self._leaves else None
        self._driver = Driver(self.robot.limits, style, self.robot, beside)
        self._driver.reset(Command(world.robot.v, world.robot.w))

    def way(self) -> FloatArray | None:
        """Return the curve of the last tick; see `Action.way`."""
        return self._driver.way()

    def step(self, world: World) -> Step:
        """Return the next command; see `Action.step`."""
        state, speed = world.robot, self._goal.speed
        rel = self._target.relative(state.pose)
        if reached(rel, state.v, speed):
            command = self._driver.send(speed, 0.0) if speed > 0.0 else Command()
            return finished(Status.SUCCEEDED, "arrived at the goal", command)
        self._leaves = self._leaves and self._is_near_ball(world)
        if self._leaves:
            return Step(self._driver.command(-_BACKING, 0.0), Status.RUNNING, "backing off from the ball")
        if straightens(rel, speed, _STRAIGHTENING if self._to_ball else math.pi):
            return Step(self._driver.turn(-rel.yaw), Status.RUNNING, "turning into the goal's heading")
        return Step(
            self._driver.follow(state, self._target, speed), Status.RUNNING, "following the curve to the goal"
        )

    def _is_near_ball(self, world: World) -> bool:
        """Return whether the robot may touch the ball when it turns."""
        ball, (x, y, _) = ball_of(world), world.robot.pose
        return ball is not None and math.hypot(ball.x - x, ball.y - y) < ball_clearance(self.robot)

    def _lies_at_goal(self, ball: ObjectState | None) -> bool:
        """Return whether the ball lies where the goal wants it in the robot's front."""
        front = self.robot.hold_point(self._target)
        return ball is not None and math.hypot(ball.x - front.x, ball.y - front.y) < _AT_BALL
