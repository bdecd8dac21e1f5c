"""The paper's actions: each follows one Bezier curve (paper, section 3)."""

from __future__ import annotations

import math
from typing import ClassVar

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.domains.soccer.bezier.driving import CurveShape, Driver, Style, reached, straightens
from ator_ros.domains.soccer.field import BALL, ball_of, behind_line, field_of, is_in_goal
from ator_ros.domains.soccer.thresholds import ball_clearance, check_arrival, gone_beyond
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.robot.description import Robot
from ator_ros.tops.objects import is_at_front
from ator_ros.world.state import STOP, Command, ObjectState, Standstill, World

TO_POSE = Style(CurveShape(0.3, 0.05, 0.12, 0.25), 60.0, 2.2, 0.6)
TO_BALL = Style(CurveShape(0.25, 0.3, 0.12, 0.25), 60.0, 2.0, 0.6)

_AT_BALL = 0.2  # m between the ball and the hold of a robot at the goal
_BACKING = 0.3
"""Speed in m/s at which the robot backs off from a ball in its front."""
_STRAIGHTENING = 0.5  # rad that a robot may turn on the spot with the ball between its fins


class _BezierAction(Action):
    """An action that follows a curve."""

    _driver: Driver

    def path(self) -> FloatArray | None:
        """Return the curve of the last tick; see `Action.path`."""
        return self._driver.path()


class BezierGoToPose(_BezierAction):
    """Drive to a pose; where the goal is a ball, come from behind it and leave it in its place.

    Forward only, except to back off from a ball in front that is not at the goal. A goal with a speed is
    passed at that speed; one that was missed is driven at again.
    """

    name: ClassVar[str] = "goToPose"

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_arrival(goal, self.robot.limits.v, self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        ball = ball_of(world)
        self._to_ball = self._lies_at_goal(ball)
        self._is_backing_off = not self._to_ball and is_at_front(world, self.robot, BALL)
        style = TO_BALL if self._to_ball else TO_POSE
        beside = ball if self._to_ball or self._is_backing_off else None
        last = Command(world.robot.v, world.robot.w)
        self._driver = Driver(self.robot.limits, style, last, self.robot, beside)

    def step(self, world: World) -> Step:
        """Return the next command; see `Action.step`."""
        state, speed = world.robot, self._goal.speed
        rel = self._target.relative(state.pose)
        if reached(rel, state.v, speed):
            command = self._driver.send(speed, 0.0) if speed > 0.0 else STOP
            return finished(Status.SUCCEEDED, "arrived at the goal", command)
        self._is_backing_off = self._is_backing_off and self._is_near_ball(world)
        if self._is_backing_off:
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


_LOOSE, _TAKEN = 0.025, 0.01
"""Distances in m of the ball before the hold. A ball that is farther away than the first is taken in, up to
the second, before the first turn, in which it would slip out."""

_TAKING = 0.3
"""Speed in m/s at which the ball is taken in."""

STRAIGHTENING = 0.3
"""Angle in rad that the robot may turn on the spot with the ball, once it is at the goal."""

HANDLE = 0.1
"""Length of the curve's handles in m: the least radius that the ball is led on."""

ROTATION = 0.5
"""Greatest rotational velocity in rad/s with the ball: it makes turning with the ball dear."""


def dribbling(handle: float = HANDLE, rotation: float = ROTATION) -> Style:
    """Return how the ball is dribbled with handles of a length in m, and at most at a rotation in rad/s."""
    return Style(CurveShape(handle, 0.05, 0.05, 0.15), 1.2 / handle, rotation, 0.36)


def check_held(world: World, robot: Robot, name: str) -> None:
    """Raise ActionError unless the ball lies in the robot's front."""
    distance, most = robot.hold_offset(world, BALL), gone_beyond(robot)
    if distance > most:
        raise ActionError(
            f"{name}: expected the ball within {most:g} m of the hold, it is {distance:.2f} m away"
        )


class BezierDribbleBall(_BezierAction):
    """Push the ball to a pose: turning slowly, and never braking harder than the ball.

    A ball that lies loosely between the tips of the fins is taken in first, straight ahead.
    A goal with a speed is passed at that speed. A goal that was missed is driven at again in a loop.
    """

    name: ClassVar[str] = "dribbleBall"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._limits = robot.holder_for(self.name).limits

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_arrival(goal, self._limits.v, self.name)
        check_held(world, self.robot, self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        self._driver = Driver(self._limits, dribbling(), Command(world.robot.v, world.robot.w))
        self._is_taking_in = self._gap(world) > _LOOSE

    def step(self, world: World) -> Step:
        """Return the next command; see `Action.step`."""
        distance = self.robot.hold_offset(world, BALL)
        if distance > gone_beyond(self.robot):
            return finished(Status.FAILED, f"lost the ball: it is {distance:.2f} m from the hold")
        state, speed = world.robot, self._goal.speed
        rel = self._target.relative(state.pose)
        if reached(rel, state.v, speed):
            command = self._driver.command(speed, 0.0)
            return finished(Status.SUCCEEDED, "arrived at the goal with the ball", command)
        self._is_taking_in = self._is_taking_in and self._gap(world) > _TAKEN
        if self._is_taking_in:
            return Step(self._driver.command(_TAKING, 0.0), Status.RUNNING, "taking the ball in")
        if straightens(rel, speed, STRAIGHTENING):
            return Step(self._driver.turn(-rel.yaw), Status.RUNNING, "turning into the goal's heading")
        return Step(
            self._driver.follow(state, self._target, speed),
            Status.RUNNING,
            "dribbling along the curve to the goal",
        )

    def _gap(self, world: World) -> float:
        """Return the distance in m of the ball before the hold, along the robot's heading."""
        ball, pose = world.objects[BALL], world.robot.pose
        return self.robot.hold_point(pose).relative(Pose(ball.x, ball.y, 0.0)).x


_POST_ROOM = 0.2  # m between a goalpost and the ball on its way
_ROLL_RESERVE = 0.25  # m that the ball could roll on behind the line
_HANDLE, _ROTATION = 0.12, 0.6  # m, rad/s
_SLANT = 0.9  # rad
_BEFORE_LINE = 0.35  # m between ball and line where the curve ends
_LINE = 0.02
_BEND = 4.0  # 1/m
_SHOT_OVER = Standstill(0.05)
"""A ball and a robot too slow to score any more, before either has come to rest."""


class BezierShoot(_BezierAction):
    """Send the ball into a goal by motion alone.

    The goal's position lies in the mouth of one of the field's goals; its heading and speed do not matter.
    """

    name: ClassVar[str] = "shoot"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._limits = robot.holder_for(self.name).limits

    def start(self, world: World, goal: Goal) -> None:
        """Commit to the goal mouth that `goal` lies in; see `Action.start`."""
        check_arrival(goal, self.robot.limits.v, self.name)
        check_held(world, self.robot, self.name)
        field = field_of(self.robot)
        x, y = goal.pose.x, goal.pose.y
        if field.goal_width <= 0.0:
            raise ActionError("shoot: expected a scene with goals, it has no bays")
        side = field.side_of(x)
        line, middle = field.goal_center(side)
        if abs(x - line) > 0.5 * field.goal_depth or abs(y - middle) > field.goal_width / 2:
            raise ActionError(f"shoot: expected a position in a goal's mouth, got ({x:.2f}, {y:.2f}) m")
        self._side = side
        self._middle = max(-1.0, min(1.0, (y - middle) / (field.goal_width / 2))) * self._half_mouth()
        last = Command(world.robot.v, world.robot.w)
        self._driver = Driver(self._limits, dribbling(_HANDLE, _ROTATION), last)
        self._released = False

    def _half_mouth(self) -> float:
        """Return half the width in m in which the ball's center passes clear of the posts."""
        return field_of(self.robot).goal_width / 2 - self.robot.scene.radius(BALL) - _POST_ROOM

    def step(self, world: World) -> Step:
        """Return the next command; see `Action.step`."""
        ball = ball_of(world)
        if ball is None:
            return finished(Status.FAILED, "lost the ball: it is not seen any more")
        field = field_of(self.robot)
        mouth = Pose(*field.goal_center(self._side), 0.0)
        if is_in_goal(ball, mouth, field, _LINE):
            return finished(Status.SUCCEEDED, "the ball is in the goal", STOP)
        if self._released:
            return self._watch(world, ball)
        distance = self.robot.hold_offset(world, BALL)
        if distance > gone_beyond(self.robot):
            return finished(Status.FAILED, f"lost the ball: it is {distance:.2f} m from the hold")
        crossing = self._crossing(world.robot.pose)
        if crossing is None or abs(crossing - mouth.y) > self._half_mouth():
            target = self._target(world.robot.pose)
            command = self._driver.follow(world.robot, target, self._limits.v)
            return Step(command, Status.RUNNING, "dribbling along a curve to the goal's mouth")
        return self._run_up(world, -behind_line(ball, mouth, field), crossing - mouth.y)

    def _crossing(self, pose: Pose) -> float | None:
        """Return y (m) where the robot's straight way ahead crosses the goal line; None where it doesn't."""
        hold = self.robot.hold_point(pose)
        forward = self._side * math.cos(pose.yaw)
        short = self._side * (field_of(self.robot).goal_center(self._side)[0] - hold.x)
        if forward < 0.3 or short < 0.0:
            return None
        return hold.y + short / forward * math.sin(pose.yaw)

    def _target(self, pose: Pose) -> Pose:
        """Return the pose of the axle before the mouth, in the direction from here up to a greatest slant."""
        straight = 0.0 if self._side > 0 else math.pi
        line, y = field_of(self.robot).goal_center(self._side)
        hold = self.robot.hold_point(pose)
        slant = wrap_angle(math.atan2(y + self._middle - hold.y, line - hold.x) - straight)
        mouth = Pose(line, y + self._middle, straight + max(-_SLANT, min(_SLANT, slant)))
        return mouth.ahead(-self.robot.hold - _BEFORE_LINE)

    def _run_up(self, world: World, short: float, crossing: float) -> Step:
        """Drive straight at the mouth, and brake when the ball, `short` m before the line, will roll in.

        `crossing` is where it will cross the line, in m from the middle along y.
        """
        state = world.robot
        way = max(short, 0.0) / max(abs(math.cos(state.pose.yaw)), 0.3) + _ROLL_RESERVE
        roll = state.v**2 / (2.0 * self.robot.scene.objects[BALL].rolling_deceleration)
        if roll > way and abs(state.w) < 0.3:
            self._released = True
            return Step(STOP, Status.RUNNING, "braking: the ball rolls on into the goal")
        # Steer mildly from the posts toward the middle of the mouth.
        aim = max(-0.5, min(0.5, self._side * (self._middle - crossing)))
        bend = aim / max(short + 0.5, 0.5) if abs(aim) > 0.1 else 0.0
        return Step(
            self._driver.command(self._limits.v, max(-_BEND, min(_BEND, bend))),
            Status.RUNNING,
            "running up to the shot",
        )

    def _watch(self, world: World, ball: ObjectState) -> Step:
        """Brake, and wait until the ball has crossed the line or come to rest."""
        if _SHOT_OVER.holds(ball.speed) and _SHOT_OVER.holds(world.robot.v):
            return finished(Status.FAILED, "missed: the ball came to rest outside the goal")
        return Step(STOP, Status.RUNNING, "waiting for the ball to roll into the goal")
