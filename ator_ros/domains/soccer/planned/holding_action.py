"""What dribbleBall and shoot share: they begin with the ball in front and fail when they lose it."""

from __future__ import annotations

from ator_ros.actions.base import ActionError, Goal
from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.planned.holding import held_limits
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.domains.soccer.planned.planner import prepare
from ator_ros.domains.soccer.thresholds import gone_beyond
from ator_ros.motion.manoeuvre import Side
from ator_ros.robot.description import Robot
from ator_ros.world.state import World


class HoldingAction(PlannedAction):
    """A planned action with the ball in front, within the robot's limits for dribbling."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, held_limits(robot, self.name))
        # Backing off would leave the ball behind.
        self.reserve = max(0.0, robot.limits.brake - self.plan_limits.brake)

    def prepare(self, entries: tuple[Side, ...], exits: tuple[Side, ...]) -> None:
        """Compute the tables of ways to begin and to end.

        Raises
        ------
        ActionError
            There are none: the ball rolls so freely that it leaves in any turn.
        """
        if not (entries and exits):
            raise ActionError(f"{self.name}: expected a turn in which the ball stays in front, there is none")
        prepare(entries, exits, self.plan_limits)

    def start(self, world: World, goal: Goal) -> None:
        """Plan the way to `goal`; see `Action.start`."""
        offset = self.robot.hold_offset(world, BALL)
        if offset > gone_beyond(self.robot):
            raise ActionError(f"{self.name}: expected the ball in front, it is {offset:.2f} m from there")
        super().start(world, goal)

    def check(self, world: World) -> str | None:
        """Return whether the ball is lost."""
        offset = self.robot.hold_offset(world, BALL)
        lost = offset > gone_beyond(self.robot)
        return f"lost the ball, it is {offset:.2f} m from the front" if lost else None
