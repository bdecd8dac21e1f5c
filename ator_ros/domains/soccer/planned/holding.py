"""Moving with a ball that is only pushed: what keeps it in front, how it turns, and dribbleBall."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache

from ator_ros.actions.base import ActionError, Goal
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.domains.soccer.planned.planner import Obstacles, fastest, prepare
from ator_ros.domains.soccer.thresholds import gone_beyond
from ator_ros.motion.displacements import TurnDriving
from ator_ros.motion.manoeuvre import Manoeuvre, Side
from ator_ros.motion.planning import Planning
from ator_ros.motion.search import search_tables
from ator_ros.robot.description import Limits, Robot
from ator_ros.world.state import World

MARGIN = 0.05  # m/s^2 of push that is always left
# Turn rates, speeds and changes of speed as shares of the limits for dribbling.
_RATES = (1.0, 0.83, 0.67, 0.5, 0.33)
ENTRY_RATES = _RATES[::2]
"""Of the first turn."""
_SLOW_RATES = (0.17, 0.08, 0.04)  # of robots that lose the ball in faster turns
_ENTRY_SPEEDS = (0.0, 0.1, 0.2, 0.35, 0.55, 0.8)
MOST_GAINED = 0.9625  # what plans may use of a limit is a little more
_ENTRY_GAINS = (0.0, 0.25, 0.5, 0.75, MOST_GAINED)
_EXIT_SPEEDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.75, 0.95)
_EXIT_LOSSES = (0.0, 0.5, 0.9)
_RUN_UP_SPEEDS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.35, 0.55, 0.8)
_RUN_UP_GAINS = (*(step / 16 for step in range(15)), MOST_GAINED)
RUN_UP_RATES = tuple(1.0 - 0.02 * step for step in range(40))
_RELEASE_SPEEDS = (0.3, 0.5, 0.75, 0.95)
LARGEST_TURN = math.radians(300.0)
_DIGITS = 6  # of m/s and m/s^2: the same ways to drive have the same numbers, by which tables are kept


def held_limits(robot: Robot, what: str) -> Limits:
    """Return the limits that keep the ball in the holder, which `what` needs."""
    limits = robot.holder_for(what).limits
    rolling = robot.scene.objects[BALL].rolling_deceleration
    return dataclasses.replace(limits, brake=min(limits.brake, max(rolling - MARGIN, 0.5 * rolling)))


def push(robot: Robot, v: float, w: float, acceleration: float) -> float:
    """Return how hard the front presses against the held ball, as an acceleration in m/s^2.

    The ball, ahead of the axle by `hold`, is on a circle: it needs a centripetal acceleration toward the
    axle, for which only its own rolling resistance and the robot's acceleration (m/s^2) can make up.
    Negative: it leaves.
    """
    swing = robot.hold * w
    speed = math.hypot(v, swing)
    resistance = robot.scene.objects[BALL].rolling_deceleration * (v / speed if speed > 0.0 else 0.0)
    return acceleration - robot.hold * w * w + resistance


def fastest_rate(robot: Robot, v: float, acceleration: float, slower: int = 0) -> float:
    """Return the greatest turn rate in rad/s, of some, that keeps the ball at `v` (m/s) and an acceleration.

    Where none does, the least of them: a robot so weak loses the ball in any turn. `slower` is a number of
    steps to a slower rate, or a faster one where it is negative.
    """
    fastest = robot.holder_for("pushing a ball").limits.w
    rates = [rate * fastest for rate in (*_RATES, *_SLOW_RATES)]
    kept = (step for step, w in enumerate(rates) if push(robot, v, w, acceleration) >= MARGIN)
    return rates[min(max(next(kept, len(rates)) + slower, 0), len(rates) - 1)]


@lru_cache(maxsize=256)
def entry_sides(robot: Robot, limits: Limits, speed: float) -> tuple[Side, ...]:
    """Return the ways to begin at `speed` (m/s) with the ball: straight to some speed, then turn."""
    sides = []
    for rate in ENTRY_RATES:
        for v in sorted({*_shares(_ENTRY_SPEEDS, limits.v), speed}):
            lead = _straight(limits, speed, v)
            for change in _shares(_ENTRY_GAINS, gain_of(robot)):
                turn = TurnDriving(v, change, rate * limits.w)
                if keeps_ball(robot, turn, limits.v):
                    sides.append(Side(lead, speed, turn))
    return tuple(sides)


@lru_cache(maxsize=256)
def run_up_sides(robot: Robot, limits: Limits, speed: float) -> tuple[Side, ...]:
    """Return the ways to begin a run-up at `speed` (m/s): straight, then turn as fast as the ball allows."""
    sides = []
    for v in sorted({*_shares(_RUN_UP_SPEEDS, limits.v), speed}):
        lead = _straight(limits, speed, v)
        for change in _shares(_RUN_UP_GAINS, gain_of(robot)):
            turn = fastest_turn(robot, limits, v, change)
            sides += [Side(lead, speed, turn)] if turn else []
    return tuple(sides)


def fastest_turn(robot: Robot, limits: Limits, v: float, change: float) -> TurnDriving | None:
    """Return the fastest turn from `v` (m/s) with a change of speed (m/s^2) that keeps the ball, if any."""
    turns = (TurnDriving(v, change, rate * limits.w) for rate in RUN_UP_RATES)
    return next((turn for turn in turns if keeps_ball(robot, turn, limits.v)), None)


@lru_cache(maxsize=256)
def release_sides(robot: Robot, limits: Limits) -> tuple[Side, ...]:
    """Return the ways to end at full speed with the ball: turn at a constant speed, then run up straight."""
    speeds = _shares(_RELEASE_SPEEDS, limits.v)
    turns = (TurnDriving(v, 0.0, rate * limits.w) for v in speeds for rate in _RATES[::2])
    return tuple(
        Side(_straight(limits, turn.speed, limits.v), limits.v, turn)
        for turn in turns
        if push(robot, turn.speed, turn.turn_rate, 0.0) >= MARGIN
    )


@lru_cache(maxsize=256)
def exit_sides(robot: Robot, limits: Limits, speed: float) -> tuple[Side, ...]:
    """Return the ways to end at `speed` (m/s) with the ball: turn, perhaps slower, then brake straight."""
    sides = []
    for rate in _RATES:
        for v in sorted({*_shares(_EXIT_SPEEDS, limits.v), speed} - {0.0}):
            run = _straight(limits, v, speed)
            for change in _shares(_EXIT_LOSSES, limits.brake):
                turn = TurnDriving(v, change, rate * limits.w)
                if push(robot, v, turn.turn_rate, -change) >= MARGIN:
                    sides.append(Side(run, speed, turn))
    return tuple(sides)


def keeps_ball(robot: Robot, turn: TurnDriving, fastest: float) -> bool:
    """Return whether a turn keeps the ball, also at the speed `fastest` (m/s), where it gains no more."""
    v, gain, w = turn.speed, turn.acceleration, turn.turn_rate
    lasts = v + gain * LARGEST_TURN / w < fastest
    return push(robot, v, w, gain) >= MARGIN and (lasts or push(robot, fastest, w, 0.0) >= MARGIN)


def gain_of(robot: Robot) -> float:
    """Return the greatest gain of speed with the ball in m/s^2."""
    return min(robot.holder_for("pushing a ball").limits.a, robot.limits.a)


def _shares(shares: Sequence[float], limit: float) -> list[float]:
    return [round(share * limit, _DIGITS) for share in shares]


def _straight(limits: Limits, v1: float, v2: float) -> float:
    """Return the shortest distance in m in which the speed goes from v1 to v2 (m/s)."""
    return abs(v2 * v2 - v1 * v1) / (2.0 * (limits.a if v2 > v1 else limits.brake))


class HoldingAction(PlannedAction):
    """A planned action with the ball in front, within the robot's limits for dribbling."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, held_limits(robot, self.name))
        # Backing off would leave the ball behind.
        self.reserve = max(0.0, robot.limits.brake - self.plan_limits.brake)

    def prepare(self, entries: tuple[Side, ...], exits: tuple[Side, ...]) -> None:
        """Compute the tables of these sides; raise ActionError if there are none."""
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
    """Pushes the ball to a pose of the hold: forward only, without turning on the spot (paper, section 3)."""

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
