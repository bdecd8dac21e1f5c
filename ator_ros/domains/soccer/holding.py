"""dribbleBall, and which motions keep a pushed ball in front."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache

from ator_ros.actions.base import ActionError, Goal
from ator_ros.bases.description import Robot
from ator_ros.bases.differential.durations import change_distance
from ator_ros.bases.differential.limits import Limits
from ator_ros.bases.differential.manoeuvre import Manoeuvre, Side
from ator_ros.bases.differential.paths import Ends, entries_of, exits_of
from ator_ros.bases.differential.robot import DifferentialRobot, differential
from ator_ros.domains.planned.free_paths import Obstacles, fastest
from ator_ros.domains.planned.planned_action import PlannedAction
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.thresholds import check_held, lost_ball
from ator_ros.world.state import World

_MARGIN = 0.05  # m/s^2: least push against the ball, in turns and while braking
# Speeds, changes of speed and turn rates as shares of the limits for dribbling.
_ENTRY_SPEEDS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.35, 0.55, 0.8)
# the last a little less than `PLAN_SHARE`
_ENTRY_GAINS = (*(step / 16 for step in range(15)), 0.9625)
_EXIT_SPEEDS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.75, 0.95)
_EXIT_LOSSES = (0.0, 0.25, 0.5, 0.75, 0.9)
_RATES = tuple(1.0 - 0.02 * step for step in range(40))
# Those of turns before a shot, at constant speed.
_RELEASE_SPEEDS = (0.3, 0.5, 0.75, 0.95)
_RELEASE_RATES = (1.0, 0.67, 0.33)
_LARGEST_TURN = math.radians(300.0)  # greatest angle in rad of a turn with the ball
_DIGITS = 6  # of m/s and m/s^2: tables are cached by these numbers


def held_limits(robot: DifferentialRobot, what: str) -> Limits:
    """Return the limits that keep the ball in the holder.

    Raises ConfigError, with `what` as the name of the action, for a robot without a holder.
    """
    limits = robot.holder_for(what).limits
    rolling = robot.scene.objects[BALL].rolling_deceleration
    brake = min(limits.brake, max(rolling - _MARGIN, 0.5 * rolling))
    return dataclasses.replace(limits, brake=brake)


def _push(
    robot: DifferentialRobot,
    v: float,
    w: float,
    acceleration: float,
) -> float:
    """Return the push of the front against the held ball, in m/s^2; negative if the ball leaves.

    The ball, `hold` ahead of the axle, is on a circle. Only its rolling resistance and the
    acceleration of the robot (m/s^2) provide the centripetal acceleration toward the axle.
    """
    swing = robot.hold * w
    speed = math.hypot(v, swing)
    backward_share = v / speed if speed > 0.0 else 0.0
    resistance = robot.scene.objects[BALL].rolling_deceleration * backward_share
    return acceleration - robot.hold * w * w + resistance


@lru_cache(maxsize=16)
def entries_with_ball(robot: DifferentialRobot, limits: Limits, speed: float) -> Ends:
    """Return the entries at `speed` (m/s) with the ball.

    The robot drives straight, then turns as fast as the ball allows. Raises ConfigError for a robot
    without a holder.
    """
    gain = min(robot.holder_for("pushing a ball").limits.a, robot.limits.a)
    sides = []
    for v in sorted({*_shares(_ENTRY_SPEEDS, limits.v), speed}):
        lead = change_distance(speed, v, limits)
        for change in _shares(_ENTRY_GAINS, gain):
            rate = _fastest_rate(robot, limits, v, change)
            sides += [Side(lead, speed, v, change, rate)] if rate else []
    return entries_of(sides, limits)


@lru_cache(maxsize=4096)
def _fastest_rate(
    robot: DifferentialRobot,
    limits: Limits,
    v: float,
    change: float,
) -> float:
    """Return the greatest turn rate in rad/s that keeps the ball at a changing speed; 0: none."""
    for rate in (share * limits.w for share in _RATES):
        # The turn must also keep the ball at the greatest speed, if that is reached.
        pushes = [_push(robot, v, rate, change)]
        if v + change * _LARGEST_TURN / rate >= limits.v:
            pushes.append(_push(robot, limits.v, rate, 0.0))
        if all(push >= _MARGIN for push in pushes):
            return rate
    return 0.0


@lru_cache(maxsize=16)
def release_exits(robot: DifferentialRobot, limits: Limits) -> Ends:
    """Return the exits at full speed with the ball.

    The robot turns at constant speed, then runs up straight. The table is empty if the ball leaves
    in each turn.
    """
    sides = []
    for v in _shares(_RELEASE_SPEEDS, limits.v):
        run = change_distance(v, limits.v, limits)
        for share in _RELEASE_RATES:
            rate = share * limits.w
            if _push(robot, v, rate, 0.0) >= _MARGIN:
                sides.append(Side(run, limits.v, v, 0.0, rate))
    return exits_of(sides, limits)


@lru_cache(maxsize=16)
def dribble_exits(robot: DifferentialRobot, limits: Limits, speed: float) -> Ends:
    """Return the exits at `speed` (m/s) with the ball.

    The robot turns as fast as the ball allows, then drives straight. The table is empty if the ball
    leaves in each turn.
    """
    sides = []
    for v in sorted({*_shares(_EXIT_SPEEDS, limits.v), speed} - {0.0}):
        run = change_distance(v, speed, limits)
        for change in _shares(_EXIT_LOSSES, limits.brake):
            rates = [share * limits.w for share in _RATES]
            held = (rate for rate in rates if _push(robot, v, rate, -change) >= _MARGIN)
            fastest_held = next(held, 0.0)
            if fastest_held:
                sides.append(Side(run, speed, v, change, fastest_held))
    return exits_of(sides, limits)


def _shares(shares: Sequence[float], limit: float) -> list[float]:
    return [round(share * limit, _DIGITS) for share in shares]


class HoldingAction(PlannedAction):
    """A planned action with the ball in front, within the limits for dribbling."""

    def __init__(self, robot: Robot) -> None:
        described = differential(robot)
        super().__init__(described, held_limits(described, self.name))
        # A robot that overshoots must not drive back, which would lose the ball. So it catches up
        # only as fast as it can brake again.
        self.reserve = max(0.0, described.limits.brake - self.plan_limits.brake)

    def _check_turns(self, *tables: Ends) -> None:
        """Raise ActionError if a table of entries or exits with the ball is empty."""
        if any(len(ends.times) == 0 for ends in tables):
            raise ActionError(
                f"{self.name}: expected a turn in which the ball stays in front, there is none"
            )

    def start(self, world: World, goal: Goal) -> None:
        """Plan the path to `goal`; see `Action.start`."""
        check_held(world, self.robot, self.name)
        super().start(world, goal)

    def check(self, world: World) -> str | None:
        """Return whether the ball is lost."""
        return lost_ball(world, self.robot)


class DribbleBall(HoldingAction):
    """Pushes the ball to a pose of the hold (paper, section 3).

    It drives forward only and does not turn on the spot.
    """

    name = "dribbleBall"
    verb = "dribbling"

    def setup(self) -> None:
        """Compute the tables of dribbles from rest to rest; see `Action.setup`."""
        limits = self.plan_limits
        entries = entries_with_ball(self.robot, limits, 0.0)
        exits = dribble_exits(self.robot, limits, 0.0)
        self._check_turns(entries, exits)

    def plan(self, world: World) -> Manoeuvre:
        """Plan forward turns and drives that keep the ball in front."""
        limits = self.plan_limits
        entries = entries_with_ball(
            self.robot,
            limits,
            round(max(0.0, world.robot.vx), 3),
        )
        exits = dribble_exits(self.robot, limits, self.goal.speed)
        start = world.robot.pose
        goal = self.target()
        return fastest(
            self.robot,
            start,
            goal,
            entries,
            exits,
            limits,
            Obstacles(),
            forward_only=True,
        )
