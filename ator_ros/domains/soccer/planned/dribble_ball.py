"""dribbleBall: drive to a pose with the ball; deceleration and rotation restricted (paper, section 3)."""

from __future__ import annotations

from ator_ros.domains.soccer.planned.clearance import Obstacles
from ator_ros.domains.soccer.planned.holding import entry_sides, exit_sides
from ator_ros.domains.soccer.planned.holding_action import HoldingAction
from ator_ros.domains.soccer.planned.planner import fastest
from ator_ros.motion.manoeuvre import Manoeuvre
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import ways_to_drive
from ator_ros.world.state import World


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
        ways = yield from ways_to_drive(entries, exits, self.plan_limits)
        return (yield from fastest(self.robot, start, goal, ways, Obstacles(), forward_only=True))
