"""goToPose: drive to a pose of the axle."""

from __future__ import annotations

from ator_ros.actions.base import ActionError
from ator_ros.bases.description import Robot
from ator_ros.bases.differential.manoeuvre import Manoeuvre
from ator_ros.bases.differential.paths import Ends
from ator_ros.bases.differential.robot import differential
from ator_ros.domains.planned.free_paths import (
    TRIES,
    Obstacles,
    fastest,
    free_entries,
    free_exits,
    turn_on_spot,
)
from ator_ros.domains.planned.planned_action import PlannedAction
from ator_ros.geometry import Pose
from ator_ros.world.state import RobotState, World

# s: motors that lag more brake too late after catching up, and the robot returns for 3 s
_LAGGING = 0.05
# m from the goal within which a standing robot only turns; less than the tolerance
_TURNS_WITHIN = 0.04
_TRIES_AT_SPEED = 1000  # paths to arrive at a speed that are checked in a tick
_SLOWER = (1.0, 0.75, 0.5)  # shares of the goal's speed that are tried one after the other, then 0


class GoToPose(PlannedAction):
    """Drives to a pose of the axle (paper: goToPose), clear of the walls of bays.

    A base with `limits.v_back` 0 never drives backward.
    """

    name = "goToPose"
    verb = "driving"

    def __init__(self, robot: Robot) -> None:
        described = differential(robot)
        super().__init__(described, described.limits)
        self._forward_only = not described.limits.backward
        if described.motor_time_constant > _LAGGING:
            self.reserve = max(0.0, described.limits.brake - self.plan_limits.brake)

    def setup(self) -> None:
        """Compute the tables of drives from rest to rest; see `Action.setup`."""
        free_entries(self.plan_limits, 0.0)
        free_exits(self.plan_limits, 0.0)

    def plan(self, world: World) -> Manoeuvre:
        """Plan a drive; see `PlannedAction.plan`."""
        # A robot that has a plan keeps it if there is no path at the goal's speed.
        slower = _SLOWER if self._tracker is None and self.goal.speed else ()
        for share in slower:
            try:
                return self._arriving(world, share * self.goal.speed)
            except ActionError:
                continue  # as when a weak robot has no room to gain speed
        return self._arriving(world, 0.0 if slower else self.goal.speed)

    def _arriving(self, world: World, speed: float) -> Manoeuvre:
        found = self.arriving(world.robot, speed)
        self._arrival_speed = speed
        return found

    def arriving(self, start: RobotState, speed: float) -> Manoeuvre:
        """Plan from `start` to arrive at `speed` (m/s); raise ActionError if there is no path."""
        return self.direct(start, speed, free_exits(self.plan_limits, speed), Obstacles())

    def direct(
        self,
        start: RobotState,
        speed: float,
        exits: Ends,
        obstacles: Obstacles,
    ) -> Manoeuvre:
        """Plan to arrive at `speed` (m/s) from a start that is clear of obstacles."""
        goal = self.target()
        turns = start.is_still and speed == 0.0 and obstacles.run == 0.0
        if turns and start.pose.distance(goal) < _TURNS_WITHIN:
            return turn_on_spot(self.robot, start.pose, goal.yaw, self.plan_limits, obstacles)
        entries = free_entries(self.plan_limits, start.vx)
        return self.fastest(start.pose, entries, exits, obstacles, tries_at(speed))

    def fastest(
        self,
        start: Pose,
        entries: Ends,
        exits: Ends,
        obstacles: Obstacles,
        tries: int,
    ) -> Manoeuvre:
        """Return the fastest clear manoeuvre to the goal among `tries` paths; see `fastest`."""
        return fastest(
            self.robot,
            start,
            self.target(),
            entries,
            exits,
            self.plan_limits,
            obstacles,
            forward_only=self._forward_only,
            tries=tries,
        )


def tries_at(speed: float) -> int:
    """Return how many paths to arrive at `speed` (m/s) are checked."""
    return TRIES if speed == 0.0 else _TRIES_AT_SPEED
