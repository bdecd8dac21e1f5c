"""What the actions of the default set share: plan once, commit, track, replan only when disturbed."""

from __future__ import annotations

import dataclasses
import math
from abc import abstractmethod
from typing import ClassVar

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.domains.soccer.planned.tracker import DISTURBED_DISTANCE, StrengthEstimator, Tracker
from ator_ros.domains.soccer.thresholds import check_arrival, gripping
from ator_ros.geometry import FloatArray, Pose
from ator_ros.motion.manoeuvre import Manoeuvre
from ator_ros.motion.planning import Planning, Search
from ator_ros.motion.trajectory import Trajectory, opening_of
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, RobotState, World

_SETTLING = 0.3  # s after which a base counts as standing whatever its odometry says


class Pause:
    """Brings a robot to rest from the state of `world`, as hard as `limits` allow."""

    def __init__(self, world: World, limits: Limits) -> None:
        self._from: RobotState = world.robot
        self._since = world.time
        self._limits = limits

    def command(self, world: World) -> Command:
        """Return the command of this tick."""
        elapsed = world.time - self._since + CONTROL_PERIOD
        return Command(
            _slowed(self._from.v, self._limits.brake * elapsed),
            _slowed(self._from.w, self._limits.aw * elapsed),
        )

    def over(self, world: World) -> bool:
        """Return whether the robot stands."""
        patient = world.time - self._since < abs(self._from.v) / self._limits.brake + _SETTLING
        return world.robot.is_still or (self.command(world) == STOP and not patient)


def _slowed(speed: float, loss: float) -> float:
    return math.copysign(max(0.0, abs(speed) - loss), speed)


# Share of the base's limits that plans use; the rest is for feedback.
PLAN_SHARE = 0.97
# Motors that lag more than this, in s, need more for feedback; never more than half.
_USUAL_LAG, _LEAST_SHARE = 0.08, 0.5
POSITION_TOLERANCE = 0.05
HEADING_TOLERANCE = 0.1
_REPLANS = 20
_AHEAD = 0.35  # s that a robot in motion drives straight on while it is planned what to do then
_LATE = 0.4  # s that a robot may be late at a goal that it passes: one that is weak falls behind its plan


class PlannedAction(Action):
    """An action that follows one planned manoeuvre.

    Parameters
    ----------
    limits : Limits
        What this action may ask of the base.
    """

    verb: ClassVar[str]
    reserve = math.inf
    """Deceleration in m/s^2 that is left to lose what the robot is too fast; see `Tracker`."""
    counts_moved_goals = True
    """Whether a new plan for a moved goal is one of those after which it gives up."""
    plans_in_motion: ClassVar[bool] = True
    """Whether a robot in motion may drive straight on for a moment while it is planned what to do then."""

    def __init__(self, robot: Robot, limits: Limits) -> None:
        super().__init__(robot)
        self.limits = limits
        self.plan_limits = planned_limits(robot, limits)

    def start(self, world: World, goal: Goal) -> None:
        """Plan the way to `goal`; see `Action.start`."""
        check_arrival(goal, self.limits.v, self.name)
        self.goal = goal
        self._arrival_speed = goal.speed
        self._replans = 0
        self._deferred = -math.inf
        self._tracker: Tracker | None = None
        self._strength = StrengthEstimator(self.robot, self.plan_limits)
        self._pause = Pause(world, self.plan_limits)
        standing = world.robot.is_still
        self._search: Search | None = None
        self._at_goal = standing and goal.speed == 0.0 and self.missed(world) is None
        if self._at_goal:
            return
        self._search = self._searched(world, standing=standing)
        if not self._commit(world, self._search, waits=True) and not standing:
            self._search = None  # it is for the state of this tick
            stops_late = abs(world.robot.v) > _AHEAD * self.plan_limits.brake  # later than a plan in motion
            if self.plans_in_motion and stops_late:
                self._search = self._searched(world, standing=False, ahead=_AHEAD)
                self._deferred = world.time  # this tick has planned enough

    @property
    def planning(self) -> bool:
        """Whether there is no plan yet; see `Action.planning`."""
        return self._tracker is None and not self._at_goal

    def path(self) -> FloatArray | None:
        """Return the plan that is followed; see `Action.path`."""
        return None if self._tracker is None else self._tracker.trajectory.poses()

    def defer_planning(self, time: float) -> None:
        """Plan nothing in the tick at `time`; see `Action.defer_planning`."""
        self._deferred = time

    @abstractmethod
    def plan(self, world: World) -> Planning[Manoeuvre]:
        """Plan from the state `world`, in which the robot does not turn; ActionError where impossible."""

    def check(self, world: World) -> str | None:  # noqa: ARG002
        """Return why the action has failed at this tick, None if it has not."""
        return None

    def outdated(self, world: World) -> bool:  # noqa: ARG002
        """Return whether what was planned for has changed."""
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
        passes = self._arrival_speed > 0.0 and world.robot.v > 0.0
        if passes and nearly_there and self._tracker.left(world) >= -_LATE:
            return self._following(world, f"{why}: driving on")
        return self.replan(world, why)

    def missed(self, world: World) -> str | None:
        """Return why the robot is not at the goal, None if it is."""
        distance, heading = self._off(world)
        # A goal that is passed at a speed is judged once per tick.
        most = max(POSITION_TOLERANCE, self._arrival_speed * CONTROL_PERIOD)
        near = distance <= most and heading <= HEADING_TOLERANCE
        return None if near else f"missed: {_described(distance, heading)}"

    def _off(self, world: World) -> tuple[float, float]:
        """Return the distance to the goal in m, and the angle to its heading in rad."""
        pose, goal = world.robot.pose, self.target()
        return pose.distance(goal), abs(pose.relative(goal).yaw)

    def _arrived(self, world: World, command: Command) -> Step:
        return finished(Status.SUCCEEDED, f"arrived, {_described(*self._off(world))}", command)

    def step(self, world: World) -> Step:
        """Follow the plan for one tick, or plan on; see `Action.step`."""
        failure = self.check(world)
        if failure is not None:
            return finished(Status.FAILED, failure)
        if self._at_goal:
            return self._arrived(world, STOP)
        tracker = self._tracker
        if tracker is None:
            return self._continue_planning(world)
        tracker.keep_time(world)
        over = tracker.left(world) <= 0.0
        # At speed, a robot at its goal may be farther along than planned by more than counts as disturbed.
        if tracker.disturbed(world) and not (over and self.missed(world) is None):
            return self.replan(world, "disturbed")
        if self.outdated(world):
            return self.replan(world, "the goal has moved", counts=self.counts_moved_goals)
        if over:
            return self.arrive(world)
        if self._search is not None:
            return self._search_while_following(world, self._search)
        return Step(tracker.command(world), Status.RUNNING, f"{self.verb}, {tracker.left(world):.1f} s to go")

    def replan(self, world: World, why: str, *, counts: bool = True) -> Step:
        """Plan again from here, or fail after too many plans of those that `counts` is true for."""
        if world.time == self._deferred:
            return self._following(world, f"{why}; planning in the next tick")
        self._replans += counts
        if self._replans > _REPLANS:
            return finished(Status.FAILED, f"{why}; gave up after {_REPLANS} new plans")
        assert self._tracker is not None
        search = self._search = self._searched(world, standing=False)
        able = self._tracker.left(world) > 0.0 and not self._tracker.disturbed(world)
        try:
            if self._commit(world, search):
                return self._following(world, f"{why}: planned again")
        except ActionError as error:
            self._search = None
            if not able:
                return finished(Status.FAILED, f"{why}; {error}")
            # A noisy position of the ball may block every way for a moment.
            return self._following(world, f"{why}; keeping to the plan: {error}")
        if able:
            return self._following(world, f"{why}; keeping to the plan while planning")
        return self._paused(world, why)

    def target(self) -> Pose:
        """Return the pose of the axle at the goal."""
        return self.goal.robot_pose(self.robot)

    # Planning in slices

    def _searched(self, world: World, *, standing: bool, ahead: float = 0.0) -> Search:
        opening = opening_of(world.robot, self.plan_limits.aw, ahead)
        planning = self.plan(dataclasses.replace(world, robot=opening.end))
        return Search(world, opening, planning, standing=standing)

    def _commit(self, world: World, search: Search, *, waits: bool = False) -> bool:
        """Search for one slice; if that finds a plan, follow it, from now on or where the search began."""
        manoeuvre = search.advance(world.time)
        if manoeuvre is None:
            return False
        trajectory = Trajectory(manoeuvre, search.opening)
        since = search.begun if self._tracker is None and search.is_in_opening(world) else world.time
        self._tracker = Tracker(
            self.robot, trajectory, since, self._strength, waits=waits, reserve=self.reserve
        )
        self._search = None
        return True

    def _search_while_following(self, world: World, search: Search) -> Step:
        """Search, while the robot follows its plan, for another one that is worth a stop."""
        if world.time == self._deferred:
            return self._following(world, "keeping to the plan; planning in the next tick")
        try:
            found = search.advance(world.time)
        except ActionError as error:
            self._search = None
            return self._following(world, f"keeping to the plan: {error}")
        if found is None:
            return self._following(world, "keeping to the plan while planning")
        return self._paused(world, "there is another way")

    def _following(self, world: World, message: str) -> Step:
        assert self._tracker is not None
        return Step(self._tracker.command(world), Status.RUNNING, message)

    def _paused(self, world: World, why: str) -> Step:
        """Stop, then plan from where the robot stands."""
        self._tracker, self._search = None, None
        self._pause = Pause(world, self.plan_limits)
        return Step(self._pause.command(world), Status.RUNNING, f"{why}; planning")

    def _continue_planning(self, world: World) -> Step:
        """Plan for one slice: driving straight on for a moment, then standing still."""
        if self._search is not None and self._search.is_in_opening(world):
            return self._plan_in_motion(world, self._search)
        search = self._search
        if self._pause.over(world) and world.time != self._deferred:
            if search is None or not search.is_still_valid(world) or self.outdated(world):
                search = self._search = self._searched(world, standing=True)
            try:
                if self._commit(world, search, waits=True):
                    return self._following(world, "planned")
            except ActionError as error:
                # After a miss it may stand at the goal nevertheless, with no way to arrive there once more.
                stands = self._replans > 0 and self.missed(world) is None
                return self._arrived(world, STOP) if stands else finished(Status.FAILED, str(error))
        return Step(self._pause.command(world), Status.RUNNING, "planning")

    def _plan_in_motion(self, world: World, search: Search) -> Step:
        """Plan for one slice for where the robot will be if it drives straight on; brake if that fails."""
        # A weak robot that stops to plan loses seconds, and meters that it may not have.
        try:
            if world.time != self._deferred and self._commit(world, search):
                return self._following(world, "planned in motion")
        except ActionError:
            return self._paused(world, "no way in motion")
        then = world.time + CONTROL_PERIOD
        self._pause = Pause(dataclasses.replace(world, time=then), self.plan_limits)
        command = Command(*search.opening.velocities(then - search.begun))
        return Step(command, Status.RUNNING, "driving on while planning")


def planned_limits(robot: Robot, limits: Limits) -> Limits:
    """Return what plans use of the limits of an action; the rest is for feedback."""
    share = PLAN_SHARE - max(0.0, robot.motor_time_constant - _USUAL_LAG)
    return gripping(robot, limits.within(robot.limits.scaled(max(share, _LEAST_SHARE))))


def _described(distance: float, heading: float) -> str:
    return f"{100 * distance:.1f} cm and {heading:.3f} rad from the goal"
