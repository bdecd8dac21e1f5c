"""Stand-ins for the example servers: actions that drive as these do, without ROS.

A *control law* computes the velocity command of an action server from the state of the robot. A
*stand-in* is an action with the control law of a server, and with its delays over ROS. So drives of
a remote action are collected and evaluated without ROS, in much less time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import lru_cache

from ator_ros.actions.base import Action, Goal, Status, Step, finished
from ator_ros.bases.description import Robot
from ator_ros.world.grid_map import GridMap
from ator_ros.world.state import STOP, Command, World
from ator_ros_examples.navfn import NavFn
from ator_ros_examples.pursuit import Law, Pursuit, PursuitThrough
from ator_ros_examples.rotate_drive_rotate import Phase, RotateDriveRotate, State


class DriveToStandIn(Action):
    """The stand-in for `drive_to_server`, whose control law is `RotateDriveRotate`.

    Its delays: the executor stops the robot, then sends the goal. The server publishes a command in
    the same tick; the executor receives its result one tick after the last command, and waits until
    the robot stands.
    """

    name = "drive_to_stand_in"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._law: Law | None = None
        self._commanded = self._sent = False

    def start(
        self,
        world: World,  # noqa: ARG002
        goal: Goal,
    ) -> None:
        """Commit to `goal`."""
        pose = goal.robot_pose(self.robot)
        self._law = self.law((pose.x, pose.y, pose.yaw))

    def take_over(self, former: Action) -> None:
        """Drive on: the server takes a newer goal while it drives."""
        assert isinstance(former, DriveToStandIn)
        assert former._law is not None
        self._sent = True
        if isinstance(self._law, Pursuit):
            self._law.take_over(former._law)

    def law(self, goal: tuple[float, float, float]) -> Law:
        """Return the control law for a goal: x, y (m) and yaw (rad)."""
        return RotateDriveRotate(goal)

    def step(self, world: World) -> Step:
        """Return the command of the server, or that of the executor before and after."""
        assert self._law is not None
        if not self._sent:
            self._sent = self._commanded and world.robot.is_standing
            self._commanded = True
        if not self._sent:
            return Step(STOP, Status.RUNNING, "stopping before the goal is sent")
        if self._law.phase is Phase.ARRIVED:
            if not world.robot.is_standing:
                return Step(STOP, Status.RUNNING, "arrived; stopping")
            return finished(Status.SUCCEEDED, "arrived")
        if self._law.phase in (Phase.MISSED, Phase.TOO_LONG):
            return finished(Status.FAILED, f"the server {self._law.phase.value}")
        robot = world.robot
        command = self._law.step(
            State(
                world.time,
                *robot.pose,
                robot.vx,
                robot.w,
            )
        )
        return Step(Command(*command), Status.RUNNING, self._law.phase.value)


class PursuitStandIn(DriveToStandIn):
    """The stand-in for `pursuit_server`, whose control law is `Pursuit`.

    `navfn` plans its paths on a map.
    """

    name = "pursue_stand_in"

    def law(self, goal: tuple[float, float, float]) -> Law:
        """Return the control law for a goal: x, y (m) and yaw (rad)."""
        grid = self.robot.grid
        return Pursuit(goal, None if grid is None else navfn(grid, self.robot))


class PursuitThroughStandIn(PursuitStandIn):
    """A stand-in that drives through goals that are passed, by the law `PursuitThrough`."""

    name = "pursue_through_stand_in"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._goals: tuple[Goal, ...] = ()

    def start(self, world: World, goal: Goal) -> None:
        """Commit to `goal`."""
        super().start(world, goal)
        self._goals = (goal,)

    def followed_by(self, goals: Sequence[Goal]) -> None:
        """Drive through all goals."""
        self._goals += tuple(goals)
        self._plan_through()

    def _plan_through(self) -> None:
        grid = self.robot.grid
        poses = [goal.robot_pose(self.robot) for goal in self._goals]
        self._law = PursuitThrough(poses, None if grid is None else navfn(grid, self.robot))

    @property
    def drives_on(self) -> bool:
        """Whether it drives through its goal."""
        return len(self._goals) > 1

    def take_over(self, former: Action) -> None:
        """Drive on: the server gets the rest of a run as a newer goal."""
        assert isinstance(former, PursuitThroughStandIn)
        self._plan_through()
        super().take_over(former)


def navfn(grid: GridMap, robot: Robot) -> NavFn:
    """Return the planner of `pursuit_server` for a robot on a map."""
    return _navfn(dataclasses.replace(grid, planner=None), robot.half_width)


@lru_cache(maxsize=4)
def _navfn(grid: GridMap, radius: float) -> NavFn:
    return NavFn(
        grid.free,
        grid.resolution,
        grid.origin,
        radius,
    )
