"""Base class of the default actions: plan once, commit, track, replan only when disturbed."""

from __future__ import annotations

import dataclasses
import math
from abc import abstractmethod
from typing import ClassVar

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.manoeuvre import Manoeuvre
from ator_ros.bases.differential.robot import DifferentialRobot
from ator_ros.bases.differential.trajectory import Trajectory, opening_of
from ator_ros.domains.planned.tracker import DISTURBED_DISTANCE, Tracker
from ator_ros.geometry import FloatArray, Pose
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, World

PLAN_SHARE = 0.97
"""Share of the base's limits that plans use; the rest is for feedback."""
_USUAL_LAG = 0.08  # s: motors that lag more need more for feedback, 1 % for each 0.01 s
_LEAST_SHARE = 0.5  # of the limits, whatever the lag
POSITION_TOLERANCE = 0.05
"""Distance in m from the goal at which a robot has arrived: 1 cm less than that of the TOPs."""
HEADING_TOLERANCE = 0.1
"""Angle in rad from the goal's heading at which a robot has arrived: less than that of the TOPs."""
# plans that bring the robot no nearer, after which an action fails: an undisturbed drive needs one
_REPLANS = 20
_LATE = 0.4  # s that a robot weaker than its description may be late at a goal with a speed


class PlannedAction(Action):
    """An action that follows one planned manoeuvre within `limits`."""

    robot: DifferentialRobot
    verb: ClassVar[str]
    reserve = math.inf
    """Deceleration in m/s^2 of the base beyond that of plans; see `Tracker`."""
    counts_moved_goals = True
    """Whether new plans for a moved goal count toward the greatest number of plans."""

    def __init__(self, robot: DifferentialRobot, limits: Limits) -> None:
        super().__init__(robot)
        self.limits = limits
        share = PLAN_SHARE - max(0.0, robot.motor_time_constant - _USUAL_LAG)
        usable = limits.within(robot.limits.scaled(max(share, _LEAST_SHARE)))
        # With a turn rate at which wheels do not slide at any speed.
        self.plan_limits = dataclasses.replace(usable, w=robot.steady_rate(usable.w, usable.v))

    def start(self, world: World, goal: Goal) -> None:
        """Plan the path to `goal`; see `Action.start`."""
        check_arrival(goal, self.limits.v, self.name)
        self.goal = goal
        self._arrival_speed = goal.speed
        self._replans = 0
        self._nearest = self._off(world)[0]  # m from the goal, when `_replans` was 0
        self._tracker: Tracker | None = None
        self._stopping = False  # because there is no path to the goal from a state in motion
        if not self.is_done(world):
            self._tracker = self._planned(world, waits=True)

    def path(self) -> FloatArray | None:
        """Return the plan that is followed; see `Action.path`."""
        return None if self._tracker is None else self._tracker.trajectory.poses()

    @abstractmethod
    def plan(self, world: World) -> Manoeuvre:
        """Plan from `world`, in which the robot does not turn; ActionError if there is no path."""

    def is_done(self, world: World) -> bool:
        """Return whether nothing is left to do at the start."""
        return world.robot.is_still and self.goal.speed == 0.0 and self.missed(world) is None

    def check(self, world: World) -> str | None:  # noqa: ARG002
        """Return why the action has failed at this tick; None if it has not."""
        return None

    def outdated(self, world: World) -> bool:  # noqa: ARG002
        """Return whether the situation has changed for which the action planned."""
        return False

    def arrive(self, world: World) -> Step:
        """Return the step at the end of the plan."""
        why = self.missed(world)
        if why is None:
            return self._arrived(world, Command(self._arrival_speed, 0.0))
        ahead, beside, heading = world.robot.pose.relative(self.target())
        straight = abs(beside) <= POSITION_TOLERANCE and abs(heading) <= HEADING_TOLERANCE
        assert self._tracker is not None
        nearly_there = straight and 0.0 < ahead <= DISTURBED_DISTANCE
        passes = self._arrival_speed > 0.0 and world.robot.vx > 0.0
        if passes and nearly_there and self._tracker.left(world) >= -_LATE:
            return self._following(world, f"{why}: driving on")
        return self.replan(world, why)

    def missed(self, world: World) -> str | None:
        """Return why the robot is not at the goal; None if it is."""
        distance, heading = self._off(world)
        # A goal with a speed is passed between two ticks.
        most = max(POSITION_TOLERANCE, self._arrival_speed * CONTROL_PERIOD)
        near = distance <= most and heading <= HEADING_TOLERANCE
        return None if near else f"missed: {_described(distance, heading)}"

    def _off(self, world: World) -> tuple[float, float]:
        """Return the distance to the goal in m and the angle to its heading in rad."""
        pose = world.robot.pose
        goal = self.target()
        return pose.distance(goal), abs(pose.relative(goal).yaw)

    def _arrived(self, world: World, command: Command) -> Step:
        return finished(Status.SUCCEEDED, f"arrived, {_described(*self._off(world))}", command)

    def step(self, world: World) -> Step:
        """Follow the plan for one tick; see `Action.step`."""
        failure = self.check(world)
        if failure is not None:
            return finished(Status.FAILED, failure)
        tracker = self._tracker
        if tracker is None:
            return self._arrived(world, STOP)
        tracker.keep_time(world)
        over = tracker.left(world) <= 0.0
        # At speed, a robot at its goal may be farther along than planned by more than counts as
        # disturbed.
        if tracker.disturbed(world) and not (over and self.missed(world) is None):
            return self.replan(world, "disturbed")
        if self.outdated(world):
            return self.replan(world, "the goal has moved", counts=self.counts_moved_goals)
        if over:
            return PlannedAction.arrive(self, world) if self._stopping else self.arrive(world)
        return Step(
            tracker.command(world),
            Status.RUNNING,
            f"{self.verb}, {tracker.left(world):.1f} s to go",
        )

    def replan(self, world: World, why: str, *, counts: bool = True) -> Step:
        """Plan again from here, or fail after too many plans for which `counts` is true.

        A base slower than described comes nearer, and arrives late.
        """
        distance, _ = self._off(world)
        if distance < self._nearest - DISTURBED_DISTANCE:
            self._nearest = distance
            self._replans = 0
        self._replans += counts
        if self._replans > _REPLANS:
            return finished(Status.FAILED, f"{why}; gave up after {_REPLANS} new plans")
        assert self._tracker is not None
        try:
            self._tracker = self._planned(world)
        except ActionError as error:
            if self._tracker.left(world) > 0.0 and not self._tracker.disturbed(world):
                # A noisy position of the ball may block all paths for a moment.
                return self._following(world, f"{why}; keeping to the plan: {error}")
            if world.robot.is_still:
                return finished(Status.FAILED, f"{why}; {error}")
            self._stopping = True
            stop = Trajectory(None, opening_of(world.robot, self.plan_limits, stops=True))
            self._tracker = self._follower(world, stop)
            return self._following(world, f"{why}; stopping: {error}")
        return self._following(world, f"{why}: planned again")

    def _planned(self, world: World, *, waits: bool = False) -> Tracker:
        """Return the tracker of a plan from `world`."""
        # A base that never drives backward may still roll back, or seem to.
        rolls_back = world.robot.vx < 0.0 and not self.robot.limits.backward
        opening = opening_of(world.robot, self.plan_limits, stops=rolls_back)
        manoeuvre = self.plan(dataclasses.replace(world, robot=opening.end))
        trajectory = Trajectory(manoeuvre, opening)
        self._expect_no_walls(trajectory)
        self._stopping = False
        return self._follower(world, trajectory, waits=waits)

    def _expect_no_walls(self, trajectory: Trajectory) -> None:
        """Raise ActionError if the map has an obstacle on a plan."""
        grid = self.robot.grid
        place = None
        if grid is not None:
            place = grid.obstacle_on(trajectory.poses(), self.robot.half_width)
        if place is not None:
            raise ActionError(
                f"expected a free path, got an obstacle of the map {grid} at ({place[0]:.2f}, "
                f"{place[1]:.2f}) m: {self.name} plans no routes around walls"
            )

    def _follower(self, world: World, trajectory: Trajectory, *, waits: bool = False) -> Tracker:
        return Tracker(self.robot, trajectory, world.time, waits=waits, reserve=self.reserve)

    def _following(self, world: World, message: str) -> Step:
        assert self._tracker is not None
        return Step(self._tracker.command(world), Status.RUNNING, message)

    def target(self) -> Pose:
        """Return the pose of the axle at the goal."""
        return self.goal.robot_pose(self.robot)


def _described(distance: float, heading: float) -> str:
    return f"{100 * distance:.1f} cm and {heading:.3f} rad from the goal"


def check_arrival(goal: Goal, most: float, action: str) -> None:
    """Raise ActionError unless the goal's arrival speed is from 0 to `most` m/s."""
    if not 0.0 <= goal.speed <= most:
        raise ActionError(
            f"{action}: expected an arrival speed from 0 to {most:g} m/s, got {goal.speed:g}"
        )
