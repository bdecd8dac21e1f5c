"""dribbleBall: drive to a pose with the ball; deceleration and rotation restricted (paper, section 3)."""

from __future__ import annotations

from ator_ros.actions.base import ActionError, Goal
from ator_ros.actions.planned.clearance import Obstacles
from ator_ros.actions.planned.holding import LOST, ball_offset, entry_sides, exit_sides
from ator_ros.actions.planned.manoeuvre import Manoeuvre
from ator_ros.actions.planned.planned_action import PlannedAction
from ator_ros.actions.planned.planner import fastest
from ator_ros.robot import Robot
from ator_ros.world import World


class DribbleBall(PlannedAction):
    """Brings the ball to a pose of the hold: pushes it, forward only, and never turns on the spot."""

    name = "dribbleBall"
    verb = "dribbling"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, robot.dribble_limits)

    def start(self, world: World, goal: Goal) -> None:
        """Plan the way to `goal`; see `Action.start`."""
        offset = ball_offset(self.robot, world)
        if offset > LOST:
            raise ActionError(f"{self.name}: expected the ball in front, it is {offset:.2f} m from there")
        super().start(world, goal)

    def plan(self, world: World) -> Manoeuvre:
        """Plan forward turns and drives that keep the ball pressed to the front."""
        entries = entry_sides(self.robot, self.plan_limits, round(max(0.0, world.robot.v), 3))
        exits = exit_sides(self.robot, self.plan_limits, self.goal.speed)
        start, goal = world.robot.pose, self.target()
        return fastest(
            self.robot, start, goal, entries, exits, self.plan_limits, Obstacles(), forward_only=True
        )

    def check(self, world: World) -> str | None:
        """Say whether the ball is lost."""
        offset = ball_offset(self.robot, world)
        return f"lost the ball, it is {offset:.2f} m from the front" if offset > LOST else None
