"""dribbleBall: drive to a pose with the ball; deceleration and rotation restricted (paper, section 3)."""

from __future__ import annotations

from ator_ros.actions.base import ActionError, Goal
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.planned.clearance import Obstacles
from ator_ros.domains.soccer.planned.holding import entry_sides, exit_sides, held_limits
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.domains.soccer.planned.planner import fastest, prepare
from ator_ros.domains.soccer.thresholds import gone_beyond
from ator_ros.motion.manoeuvre import Manoeuvre, Side
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import search_tables
from ator_ros.robot.description import Robot
from ator_ros.world.state import World


class HoldingAction(PlannedAction):
    """A planned action with the ball in front, within the robot's limits for dribbling."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, held_limits(robot, self.name))
        # Backing off would leave the ball behind.
        self.reserve = max(0.0, robot.limits.brake - self.plan_limits.brake)

    def prepare(self, entries: tuple[Side, ...], exits: tuple[Side, ...]) -> None:
        """Compute the tables of tables to begin and to end.

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


class DribbleBall(HoldingAction):
    """Pushes the ball to a pose of the hold: forward only, without turning on the spot."""

    name = "dribbleBall"
    verb = "dribbling"

    def setup(self) -> None:
        """Compute the tables of dribbles from rest to rest; see `Action.setup`."""
        limits = self.plan_limits
        self.prepare(entry_sides(self.robot, limits, 0.0), exit_sides(self.robot, limits, 0.0))

    def plan(self, world: World) -> Planning[Manoeuvre]:
        """Plan forward turns and drives that keep the ball pressed to the front."""
        entries = entry_sides(self.robot, self.plan_limits, round(max(0.0, world.robot.v), 3))
        exits = exit_sides(self.robot, self.plan_limits, self.goal.speed)
        start, goal = world.robot.pose, self.target()
        tables = yield from search_tables(entries, exits, self.plan_limits)
        return (yield from fastest(self.robot, start, goal, tables, Obstacles(), forward_only=True))
