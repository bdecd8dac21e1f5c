"""goToPose: drive to a pose along a Bezier curve that is recomputed at every tick (paper, section 3)."""

from __future__ import annotations

import math
from typing import ClassVar

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.actions.bezier.choice import BACK_SPEED, BACK_UP, Choice, choose_free
from ator_ros.actions.bezier.fan import RUN_IN, Maneuver, run_in_length
from ator_ros.actions.bezier.follow import PERIOD, curvature_now, ramped, speed_now
from ator_ros.actions.bezier.progress import Progress
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.robot import Robot
from ator_ros.world import BallState, Command, World

_LATERAL = 0.03
_LATERAL_BALL = 0.02
_HEADING = 0.05
_SHORT = 0.015
_RUN_IN_SPEED = 0.6
_AT_REST = 0.03
_AT_BALL = 0.2
_GRASP = -0.13


class GoToPose(Action):
    """Drive to a pose; where the goal is a ball, come from behind it and leave it in its place.

    A goal with a speed is passed at that speed. Forward driving, except to back up when the robot has come
    near the goal but not onto it, or is so near to the ball that it cannot turn.
    """

    name: ClassVar[str] = "goToPose"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._goal = Goal(Pose(0.0, 0.0, 0.0))
        self._reset(Command())

    def _reset(self, last: Command) -> None:
        self._last = last
        self._choice: Choice | None = None
        self._progress = Progress()
        self._backing_from: Pose | None = None
        self._straight = False

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_goal(goal, self.robot.limits.v, self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        self._reset(Command(world.robot.v, world.robot.w))

    def step(self, world: World) -> Step:
        """Give the next command; see `Action.step`."""
        pose, v = world.robot.pose, world.robot.v
        to_ball = self._to_ball(world.ball)
        rel = self._target.relative(pose)
        exact = _LATERAL_BALL if to_ball else _LATERAL
        lateral_ahead = abs(rel.y - rel.x * math.tan(max(-1.0, min(1.0, rel.yaw))))
        aligned = (
            lateral_ahead < exact
            and abs(rel.yaw) < _HEADING
            and -0.5 < rel.x < 0.05
            and abs(world.robot.w) < 0.4
        )
        self._straight = aligned or (self._straight and abs(rel.y) < exact + 0.01 and abs(rel.x) < 0.1)
        if self._straight:
            return self._run_out(world, rel)
        if abs(rel.x) < 0.03 and abs(rel.y) < _LATERAL and not to_ball and self._goal.speed == 0.0:
            return self._turn(v, self._target.yaw - pose.yaw, "turning into the goal's heading")
        if self._backing_from is not None:
            return self._back_up(pose)
        return self._follow(world, rel, to_ball)

    def _to_ball(self, ball: BallState | None) -> bool:
        """Say whether the ball lies where the goal wants it in the robot's front."""
        front = self.robot.hold_point(self._target)
        return ball is not None and math.hypot(ball.x - front.x, ball.y - front.y) < _AT_BALL

    def _run_out(self, world: World, rel: Pose) -> Step:
        """Drive the last stretch straight; `rel` is the robot in the goal's frame."""
        state, speed = world.robot, self._goal.speed
        remaining = -rel.x - state.v * PERIOD
        if speed > 0.0 and -rel.x <= state.v * PERIOD / 2:
            return finished(Status.SUCCEEDED, "passed the goal", self._command(speed, 0.0))
        if speed == 0.0 and -rel.x < _SHORT and abs(state.v) < _AT_REST:
            return finished(Status.SUCCEEDED, "arrived at the goal")
        v = math.sqrt(speed**2 + 1.6 * self.robot.limits.a * max(remaining, 0.0))
        if speed == 0.0 and -rel.x > _SHORT:
            v = max(v, 0.05)
        heading = -rel.yaw - 2.0 * rel.y * min(abs(state.v), 1.0)
        return Step(self._command(v, 3.0 * heading), Status.RUNNING, "driving the last stretch straight")

    def _turn(self, v: float, angle: float, message: str) -> Step:
        """Turn on the spot by `angle` (rad)."""
        angle = wrap_angle(angle)
        limits = self.robot.limits
        w = math.copysign(min(limits.w, math.sqrt(1.4 * limits.aw * abs(angle))), angle)
        if abs(v) > 0.3:
            w = self._last.w
        return Step(self._command(0.0, w), Status.RUNNING, message)

    def _back_up(self, pose: Pose) -> Step:
        assert self._backing_from is not None
        remaining = BACK_UP - pose.distance(self._backing_from)
        if remaining < 0.02:
            self._backing_from = None
        v = -min(BACK_SPEED, math.sqrt(1.4 * self.robot.limits.a * max(remaining, 0.0)))
        return Step(self._command(v, 0.0), Status.RUNNING, "backing up to come at the goal again")

    def _follow(self, world: World, rel: Pose, to_ball: bool) -> Step:
        state = world.robot
        run_in = run_in_length(rel) if to_ball else 0.0
        previous = self._choice.index if self._choice is not None else None
        choice = self._choice = choose_free(
            state, self._target, self.robot, run_in=run_in, ball=world.ball, previous=previous
        )
        if self._progress.stuck(world.time, choice.time):
            return finished(Status.FAILED, f"stuck: no nearer to the goal for {self._progress.patience:g} s")
        if choice.maneuver is Maneuver.TURN:
            return self._turn(state.v, choice.heading - state.pose.yaw, "turning into the curve")
        if choice.maneuver is Maneuver.BACK_UP:
            self._backing_from = state.pose
            return self._back_up(state.pose)
        limits = self.robot.limits
        v = speed_now(choice.path, limits, v=max(state.v, 0.0), end_speed=self._goal.speed)
        if to_ball:
            # Slow enough near the ball to come straight into the run-in.
            beyond = max(float(choice.path.lengths.sum()) - 2 * RUN_IN, 0.0)
            v = min(v, math.sqrt(max(_RUN_IN_SPEED, self._goal.speed) ** 2 + 1.4 * limits.a * beyond))
        lag = abs(state.w) / limits.aw
        bend = curvature_now(choice.path, yaw=state.pose.yaw, end_yaw=self._target.yaw, v=state.v, lag=lag)
        v = min(max(v, 0.1), limits.w / max(abs(bend), 1e-6))
        if to_ball and -2 * RUN_IN < rel.x < 0.0 and abs(rel.y) < 0.3:
            # Not aligned yet: stay able to stop before the fins reach the ball.
            v = min(v, math.sqrt(1.4 * limits.a * max(-rel.x + _GRASP - v * PERIOD, 0.0)))
            if v < 0.05:
                self._backing_from = state.pose
        command = self._command(v, v * bend)
        return Step(command, Status.RUNNING, f"following a curve, about {choice.time:.1f} s to go")

    def _command(self, v: float, w: float) -> Command:
        self._last = ramped(self._last, v, w, self.robot.limits)
        return self._last


def check_goal(goal: Goal, most: float, name: str) -> None:
    """Check a goal.

    Raises
    ------
    ActionError
        The goal is not finite, or its speed is not in [0, most] m/s.
    """
    if not all(math.isfinite(value) for value in (*goal.pose, goal.speed)):
        raise ActionError(f"{name}: expected a finite goal, got {goal}")
    if not 0.0 <= goal.speed <= most:
        raise ActionError(f"{name}: expected a goal speed from 0 to {most:g} m/s, got {goal.speed:g} m/s")
