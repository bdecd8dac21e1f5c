"""A simple action for tests: turn to the goal, drive, turn to the goal's heading; it ignores the ball."""

import math

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.world.state import STOP, Command, World


class TurnDriveTurn(Action):
    """Turns, drives, turns, with proportional control."""

    name = "goToPose"

    def start(self, world: World, goal: Goal) -> None:
        if not all(map(math.isfinite, goal.pose)):
            raise ActionError(f"expected a finite goal, got {goal.pose}")
        self._goal: Pose = goal.robot_pose(self.robot)

    def step(self, world: World) -> Step:
        pose = world.robot.pose
        distance = pose.distance(self._goal)
        if distance > 0.05:
            bearing = math.atan2(self._goal.y - pose.y, self._goal.x - pose.x)
            turn = wrap_angle(bearing - pose.yaw)
            speed = min(1.0, distance) * max(0.0, math.cos(turn)) ** 4
            return Step(Command(speed, self._turn(turn)), Status.RUNNING, "driving")
        turn = wrap_angle(self._goal.yaw - pose.yaw)
        if abs(turn) > 0.05 or abs(world.robot.w) > 0.1:
            return Step(Command(0.0, self._turn(turn)), Status.RUNNING, "turning")
        return finished(Status.SUCCEEDED, "arrived", STOP)

    def _turn(self, angle: float) -> float:
        limit = self.robot.limits.w
        return max(-limit, min(limit, 3.0 * angle))
