"""dribbleBall: the same curve, deceleration and rotation restricted to keep the ball (paper, section 3)."""

from __future__ import annotations

from typing import ClassVar

from ator_ros.actions.base import Action, ActionError, Goal, Point, Status, Step, finished
from ator_ros.domains.soccer.bezier.curve import CurveShape
from ator_ros.domains.soccer.bezier.driver import Driver, Style, check_goal, reached, straightens
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.thresholds import gone_beyond
from ator_ros.geometry import FloatArray, Pose
from ator_ros.robot.description import Robot
from ator_ros.world.state import Command, World

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
    """Check that the ball lies in the robot's front.

    Raises
    ------
    ActionError
        It doesn't.
    """
    distance, most = robot.hold_offset(world, BALL), gone_beyond(robot)
    if distance > most:
        raise ActionError(
            f"{name}: expected the ball within {most:g} m of the hold, it is {distance:.2f} m away"
        )


class BezierDribbleBall(Action):
    """Push the ball to a pose: turning slowly, and never braking harder than the ball.

    A ball that lies loosely between the tips of the fins is taken in first, straight ahead.
    A goal with a speed is passed at that speed. A goal that was missed is driven at again in a loop.
    """

    name: ClassVar[str] = "dribbleBall"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._limits = robot.holder_for(self.name).limits
        self._driver = Driver(self._limits, dribbling())
        self._goal = Goal(Pose(0.0, 0.0, 0.0), point=Point.HOLD)

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`; see `Action.start`."""
        check_goal(goal, self._limits.v, self.name)
        check_held(world, self.robot, self.name)
        self._goal = goal
        self._target = goal.robot_pose(self.robot)
        self._driver.reset(Command(world.robot.v, world.robot.w))
        self._takes = self._room(world) > _LOOSE

    def way(self) -> FloatArray | None:
        """Return the curve of the last tick; see `Action.way`."""
        return self._driver.way()

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
        self._takes = self._takes and self._room(world) > _TAKEN
        if self._takes:
            return Step(self._driver.command(_TAKING, 0.0), Status.RUNNING, "taking the ball in")
        if straightens(rel, speed, STRAIGHTENING):
            return Step(self._driver.turn(-rel.yaw), Status.RUNNING, "turning into the goal's heading")
        return Step(
            self._driver.follow(state, self._target, speed),
            Status.RUNNING,
            "dribbling along the curve to the goal",
        )

    def _room(self, world: World) -> float:
        """Return the distance in m of the ball before the hold, along the robot's heading."""
        ball, pose = world.objects[BALL], world.robot.pose
        return self.robot.hold_point(pose).relative(Pose(ball.x, ball.y, 0.0)).x
