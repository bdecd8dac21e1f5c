"""What the actions of the default set share: plan once, commit, track, replan only when disturbed."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from typing import ClassVar

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.actions.planned.manoeuvre import Manoeuvre
from ator_ros.actions.planned.opening import opening_of
from ator_ros.actions.planned.tracker import Tracker
from ator_ros.actions.planned.trajectory import Trajectory
from ator_ros.geometry import Pose
from ator_ros.robot import Limits, Robot
from ator_ros.world import Command, World

# Share of the base's limits that plans use; the rest is for feedback.
PLAN_SHARE = 0.97
POSITION_TOLERANCE = 0.05
HEADING_TOLERANCE = 0.1
_REPLANS = 20


class PlannedAction(Action):
    """An action that follows one planned manoeuvre.

    Parameters
    ----------
    robot : Robot
        Shape and limits.
    limits : Limits
        What this action may ask of the base.
    """

    verb: ClassVar[str]

    def __init__(self, robot: Robot, limits: Limits) -> None:
        super().__init__(robot)
        self.limits = limits
        self.plan_limits = limits.within(robot.limits.scaled(PLAN_SHARE))

    def start(self, world: World, goal: Goal) -> None:
        """Plan the way to `goal`; see `Action.start`."""
        if not 0.0 <= goal.speed <= self.limits.v:
            raise ActionError(
                f"{self.name}: expected an arrival speed from 0 to {self.limits.v} m/s, got {goal.speed}"
            )
        self.goal = goal
        self._replans = 0
        self._commit(world, waits=True)

    @abstractmethod
    def plan(self, world: World) -> Manoeuvre:
        """Plan from the state `world`, in which the robot does not turn; ActionError where impossible."""

    def check(self, world: World) -> str | None:  # noqa: ARG002
        """Say why the action has failed at this tick, if it has."""
        return None

    def outdated(self, world: World) -> bool:  # noqa: ARG002
        """Say whether what was planned for has changed."""
        return False

    def arrive(self, world: World) -> Step:
        """Give the step at the end of the plan."""
        pose, goal = world.robot.pose, self.goal.robot_pose(self.robot)
        error = pose.relative(goal)
        distance, heading = pose.distance(goal), abs(error.yaw)
        told = f"{100 * distance:.1f} cm and {heading:.3f} rad from the goal"
        if distance <= POSITION_TOLERANCE and heading <= HEADING_TOLERANCE:
            return finished(Status.SUCCEEDED, f"arrived, {told}", Command(self.goal.speed, 0.0))
        return self.replan(world, f"missed: {told}")

    def step(self, world: World) -> Step:
        """Follow the plan for one tick; see `Action.step`."""
        failure = self.check(world)
        if failure is not None:
            return finished(Status.FAILED, failure)
        self._tracker.wait_for_start(world)
        disturbed = self._tracker.disturbed(world)
        if disturbed or self.outdated(world):
            return self.replan(world, "disturbed" if disturbed else "the goal has moved")
        left = self._tracker.left(world)
        if left <= 0.0:
            return self.arrive(world)
        return Step(self._tracker.command(world), Status.RUNNING, f"{self.verb}, {left:.1f} s to go")

    def replan(self, world: World, why: str) -> Step:
        """Plan anew from here, or fail when that does not help any more."""
        self._replans += 1
        if self._replans > _REPLANS:
            return finished(Status.FAILED, f"{why}; gave up after {_REPLANS} new plans")
        try:
            self._commit(world)
        except ActionError as error:
            if self._tracker.left(world) <= 0.0 or self._tracker.disturbed(world):
                return finished(Status.FAILED, f"{why}; {error}")
            # A ball that is seen to jump about may block every way for a moment.
            return Step(self._tracker.command(world), Status.RUNNING, f"{why}; keeping to the plan: {error}")
        return Step(self._tracker.command(world), Status.RUNNING, f"{why}: planned anew")

    def left(self, world: World) -> float:
        """Give how long the plan still takes, in s."""
        return self._tracker.left(world)

    def target(self) -> Pose:
        """Give the pose of the axle at the goal."""
        return self.goal.robot_pose(self.robot)

    def _commit(self, world: World, *, waits: bool = False) -> None:
        opening = opening_of(world.robot, self.plan_limits.aw)
        manoeuvre = self.plan(dataclasses.replace(world, robot=opening.end))
        self._tracker = Tracker(self.robot, Trajectory(manoeuvre, opening), world.time, waits=waits)
