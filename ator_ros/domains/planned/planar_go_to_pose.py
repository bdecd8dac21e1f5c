"""goToPose of an omnidirectional base: the fastest straight motion, turning on the way."""

from __future__ import annotations

import numpy as np

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.bases.description import Robot
from ator_ros.bases.omni.omni_robot import OmniBase, omnidirectional
from ator_ros.bases.omni.planar_motion import PlanarPlan, planar_plan
from ator_ros.domains.planned.go_to_pose import GoToPose
from ator_ros.domains.planned.planar_tracker import PlanarTracker
from ator_ros.domains.planned.planned_action import (
    HEADING_TOLERANCE,
    PLAN_SHARE,
    POSITION_TOLERANCE,
    check_arrival,
)
from ator_ros.domains.planned.tracker import DISTURBED_DISTANCE
from ator_ros.domains.planned.walls import touches_walls
from ator_ros.geometry import FloatArray
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, RobotState, World

_INTERVAL = 0.05  # s between the poses of a plan that are checked and drawn
_BESIDE_PATH = 0.01  # m: greatest distance from the path of a robot that passes its goal
# plans that bring the robot no nearer, after which an action fails: an undisturbed drive needs one
_REPLANS = 20
# s between two plans of a disturbed robot: those that start at the speed of a base that does not
# follow would conceal it from the motion watch
_REPLAN_PERIOD = 0.3


class PlanarGoToPose(Action):
    """Drives an omnidirectional robot to a pose, straight and as fast as its limits allow."""

    name = "goToPose"

    def __init__(self, robot: Robot) -> None:
        described = omnidirectional(robot)
        super().__init__(described)
        self._base = described
        self._limits = described.limits.scaled(PLAN_SHARE)

    def start(self, world: World, goal: Goal) -> None:
        """Plan the motion to `goal`; see `Action.start`."""
        check_arrival(goal, self._base.limits.v, self.name)
        self._speed = goal.speed  # m/s, with which it arrives
        self._target = goal.robot_pose(self.robot)
        self._replans = 0
        self._nearest = world.robot.pose.distance(self._target)  # m, when `_replans` was 0
        self._tracker: PlanarTracker | None = None
        is_done = world.robot.is_still and goal.speed == 0.0 and self._missed(world) is None
        if not is_done:
            self._tracker = self._planned(world)

    def step(self, world: World) -> Step:
        """Follow the plan for one tick; see `Action.step`."""
        tracker = self._tracker
        if tracker is None:
            return self._arrived(world)
        tracker.keep_time(world)
        # A goal with a speed is passed between two ticks: the nearer one counts.
        is_over = tracker.left(world) <= (0.5 * CONTROL_PERIOD if self._speed else 0.0)
        why = self._missed(world)
        if is_over and why is None:
            return self._arrived(world)
        is_due = world.time - self._planned_at >= _REPLAN_PERIOD
        if is_over and why is not None:
            self._speed = 0.0  # it comes back to a goal that it did not pass
            return self._replan(world, why)
        if is_due and tracker.disturbed(world):
            return self._replan(world, "disturbed")
        return self._following(world, f"driving, {tracker.left(world):.1f} s to go")

    def path(self) -> FloatArray | None:
        """Return the plan that is followed; see `Action.path`."""
        return None if self._tracker is None else self._tracker.plan.poses(_INTERVAL)

    def _planned(self, world: World) -> PlanarTracker:
        """Return the tracker of a plan from `world`."""
        start = world.robot
        if self._tracker is not None and not start.is_still:
            # A plan that starts at the speed of a base that does not follow its commands would
            # conceal that from the motion watch.
            planned = self._tracker.planned_velocity(world)
            start = RobotState(start.pose, planned.vx, planned.w, vy=planned.vy)
        plan = self._arriving(start)
        self._expect_free(plan)
        self._planned_at = world.time
        return PlanarTracker(self._base, plan, world.time)

    def _arriving(self, start: RobotState) -> PlanarPlan:
        """Return a plan to the goal: at its speed, or at rest if the robot then misses the goal."""
        plan = planar_plan(start, self._target, self._speed, self._limits)
        end = plan.at(plan.duration).pose
        misses = end.distance(self._target) > POSITION_TOLERANCE
        if misses or abs(end.relative(self._target).yaw) > HEADING_TOLERANCE:
            self._speed = 0.0
            plan = planar_plan(start, self._target, 0.0, self._limits)
        return plan

    def _expect_free(self, plan: PlanarPlan) -> None:
        """Raise ActionError if a plan touches the walls of bays or of the map."""
        poses = plan.poses(_INTERVAL)
        if touches_walls(poses, self.robot):
            raise ActionError(f"{self.name}: expected a free path, got a wall of a bay on it")
        if self.robot.grid is None:
            return
        # The robot sweeps its width across the direction of motion, whatever its heading.
        steps = np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2])
        poses[:, 2] = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        half_width = max(self.robot.front, self.robot.rear, self.robot.half_width)
        place = self.robot.grid.obstacle_on(poses, half_width)
        if place is not None:
            raise ActionError(
                f"expected a free path, got an obstacle of the map {self.robot.grid} at "
                f"({place[0]:.2f}, {place[1]:.2f}) m: {self.name} plans no routes around walls"
            )

    def _replan(self, world: World, why: str) -> Step:
        """Plan again from here, or fail after too many plans.

        A base slower than described comes nearer, and arrives late.
        """
        distance = world.robot.pose.distance(self._target)
        if distance < self._nearest - DISTURBED_DISTANCE:
            self._nearest = distance
            self._replans = 0
        self._replans += 1
        if self._replans > _REPLANS:
            return finished(Status.FAILED, f"{why}; gave up after {_REPLANS} new plans")
        try:
            self._tracker = self._planned(world)
        except ActionError as error:
            return finished(Status.FAILED, f"{why}; {error}")
        return self._following(world, f"{why}: planned again")

    def _following(self, world: World, message: str) -> Step:
        assert self._tracker is not None
        return Step(self._tracker.command(world), Status.RUNNING, message)

    def _missed(self, world: World) -> str | None:
        """Return why the robot is not at the goal; None if it is."""
        most = max(POSITION_TOLERANCE, self._speed * CONTROL_PERIOD + _BESIDE_PATH)
        distance, heading = self._off(world)
        is_near = distance <= most and heading <= HEADING_TOLERANCE
        return None if is_near else f"missed: {_described(distance, heading)}"

    def _off(self, world: World) -> tuple[float, float]:
        """Return the distance to the goal in m and the angle to its heading in rad."""
        pose = world.robot.pose
        return pose.distance(self._target), abs(pose.relative(self._target).yaw)

    def _arrived(self, world: World) -> Step:
        command = Command(self._speed) if self._speed else STOP
        message = f"arrived, {_described(*self._off(world))}"
        return finished(Status.SUCCEEDED, message, command)


def _described(distance: float, heading: float) -> str:
    return f"{100 * distance:.1f} cm and {heading:.3f} rad from the goal"


def planned_go_to_pose(robot: Robot) -> Action:
    """Return the planned goToPose for the kind of base that a robot has.

    Raises ConfigError if there is none.
    """
    return PlanarGoToPose(robot) if isinstance(robot, OmniBase) else GoToPose(robot)
