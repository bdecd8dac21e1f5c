"""dribbleBall: the same curves, restricted so as not to lose the ball (paper, section 3)."""

from __future__ import annotations

import math
from typing import ClassVar

from ator_ros.actions.base import Action, ActionError, Goal, Point, Status, Step, finished
from ator_ros.actions.bezier.choice import choose_dribble
from ator_ros.actions.bezier.fan import run_in_length
from ator_ros.actions.bezier.follow import PERIOD, Pushing, curvature_now, ramped, speed_now
from ator_ros.actions.bezier.go_to_pose import check_goal
from ator_ros.actions.bezier.progress import Progress
from ator_ros.geometry import Pose
from ator_ros.robot import Robot
from ator_ros.world import Command, World

LOST = 0.15
"""Distance in m between ball and hold beyond which the ball counts as lost."""

_LATERAL = 0.03
_HEADING = 0.06
_SHORT = 0.01
_AT_REST = 0.03
_LEAST_SPEED = 0.3
_SHARPEST = 3.0
_LAST_BRAKING = 0.4


class BallDriver:
    """Drives a robot that pushes the ball along curves, for dribbleBall and shoot.

    Parameters
    ----------
    robot : Robot
        Shape and limits.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._pushing = Pushing.of(robot)
        self.reset(Command())

    def reset(self, last: Command) -> None:
        """Begin anew, with `last` as the command that the robot executes."""
        self._last = last
        self._previous: int | None = None
        self._progress = Progress()

    def follow(self, world: World, targets: list[Pose], *, run_in: float, end_speed: float) -> Step:
        """Give one tick along the best curve to one of the targets.

        Parameters
        ----------
        world : World
            The state.
        targets : list of Pose
            Where the axle may come to.
        run_in, end_speed : float
            Length in m of the straight line before the target, and the speed in m/s there.
        """
        state, limits = world.robot, self._robot.dribble_limits
        choice, target = choose_dribble(state, targets, self._robot, run_in=run_in, previous=self._previous)
        self._previous = choice.index
        if self._progress.stuck(world.time, choice.time):
            return finished(Status.FAILED, f"stuck: no nearer to the goal for {self._progress.patience:g} s")
        v = speed_now(choice.path, limits, v=max(state.v, 0.0), end_speed=end_speed, pushing=self._pushing)
        lag = abs(state.w) / limits.aw
        bend = curvature_now(choice.path, yaw=state.pose.yaw, end_yaw=target.yaw, v=state.v, lag=lag)
        bend = max(-_SHARPEST, min(_SHARPEST, bend))
        command = self.command(max(v, _LEAST_SPEED), bend)
        return Step(command, Status.RUNNING, f"dribbling along a curve, about {choice.time:.1f} s to go")

    def command(self, v: float, bend: float) -> Command:
        """Give the command nearest to v (m/s) on a curve (1/m) that keeps the ball pressed on."""
        limits, last = self._robot.dribble_limits, self._last
        braking = max(self._pushing.braking(abs(last.v), abs(last.w) / max(abs(last.v), 0.05)), 0.0)
        v = max(v, last.v - min(braking, limits.a) * PERIOD)
        w = max(-limits.w, min(limits.w, max(v, 0.0) * bend))
        self._last = ramped(last, min(v, limits.v), w, limits)
        return self._last

    def brake(self) -> Command:
        """Give the command that stops the robot as fast as its base can, leaving the ball."""
        self._last = ramped(self._last, 0.0, 0.0, self._robot.limits)
        return self._last


def check_held(world: World, robot: Robot, name: str) -> None:
    """Check that the ball lies in the robot's front.

    Raises
    ------
    ActionError
        It doesn't.
    """
    distance = robot.hold_offset(world)
    if distance > LOST:
        raise ActionError(
            f"{name}: expected the ball within {LOST:g} m of the hold, it is {distance:.2f} m away"
        )


class DribbleBall(Action):
    """Push the ball to a pose: never turning on the spot, never braking harder than the ball rolls out.

    A goal with a speed is passed at that speed. A goal that was missed is driven at again in a loop.
    """

    name: ClassVar[str] = "dribbleBall"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._driver = BallDriver(robot)
        self._goal = Goal(Pose(0.0, 0.0, 0.0), point=Point.HOLD)
        self._straight = False

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_goal(goal, self.robot.dribble_limits.v, self.name)
        check_held(world, self.robot, self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        self._driver.reset(Command(world.robot.v, world.robot.w))
        self._straight = False

    def step(self, world: World) -> Step:
        """Give the next command; see `Action.step`."""
        distance = self.robot.hold_offset(world)
        if distance > LOST:
            return finished(Status.FAILED, f"lost the ball: it is {distance:.2f} m from the hold")
        rel = self._target.relative(world.robot.pose)
        lateral_ahead = abs(rel.y - rel.x * math.tan(max(-1.0, min(1.0, rel.yaw))))
        turning = abs(world.robot.w)
        if lateral_ahead < _LATERAL and abs(rel.yaw) < _HEADING and -1.0 < rel.x < 0.02 and turning < 0.3:
            self._straight = True
        if self._straight and ((abs(rel.y) > _LATERAL + 0.01 and rel.x > -0.3) or rel.x > 0.04):
            self._straight = False
        if self._straight:
            return self._run_out(world, rel)
        return self._driver.follow(
            world, [self._target], run_in=run_in_length(rel), end_speed=self._goal.speed
        )

    def _run_out(self, world: World, rel: Pose) -> Step:
        """Drive the last stretch straight; `rel` is the robot in the goal's frame."""
        state, speed = world.robot, self._goal.speed
        if speed > 0.0 and -rel.x <= state.v * PERIOD / 2:
            return finished(
                Status.SUCCEEDED, "passed the goal with the ball", self._driver.command(speed, 0.0)
            )
        if speed == 0.0 and -rel.x < 2 * _SHORT and abs(state.v) < _AT_REST:
            return finished(Status.SUCCEEDED, "arrived at the goal with the ball")
        v = math.sqrt(speed**2 + 2.0 * _LAST_BRAKING * max(-rel.x - state.v * PERIOD, 0.0))
        if speed == 0.0 and -rel.x > _SHORT:
            v = max(v, 0.06)
        bend = -4.0 * rel.y - 4.0 * rel.yaw if abs(state.v) > 0.2 else 0.0
        return Step(self._driver.command(v, bend), Status.RUNNING, "driving the last stretch straight")
