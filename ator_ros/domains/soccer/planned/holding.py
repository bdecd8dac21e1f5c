"""Moving with a ball that is only pushed: what keeps it in front, and how turns are driven with it."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache

from ator_ros.domains.soccer.ball import BALL
from ator_ros.domains.soccer.planned.manoeuvre import Side
from ator_ros.domains.soccer.planned.turns import TurnDriving
from ator_ros.robot.description import Limits, Robot

MARGIN = 0.05  # m/s^2 of push that is always left
LOST = 0.15  # m off its place at which the ball counts as lost
_RATES = (1.0, 0.83, 0.67, 0.5, 0.33)
_ENTRY_SPEEDS = (0.0, 0.1, 0.2, 0.35, 0.55, 0.8)
_ENTRY_CHANGES = (0.0, 0.2, 0.4, 0.6, 0.77)
_EXIT_SPEEDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.75, 0.95)
_EXIT_CHANGES = (0.0, 0.25, 0.45)
_RUN_UP_SPEEDS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.35, 0.55, 0.8)
_RUN_UP_CHANGES = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.77)
_RUN_UP_RATES = tuple(1.0 - 0.02 * step for step in range(40))
_RELEASE_SPEEDS = (0.3, 0.5, 0.75, 0.95)


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


@lru_cache(maxsize=256)
def entry_sides(robot: Robot, limits: Limits, speed: float) -> tuple[Side, ...]:
    """Return the ways to begin at `speed` (m/s) with the ball: straight to some speed, then turn."""
    sides = []
    for rate in _RATES[::2]:
        for v in sorted({*_ENTRY_SPEEDS, speed}):
            lead = _straight(limits, speed, v)
            for change in _ENTRY_CHANGES:
                turn = TurnDriving(v, change, rate * limits.w)
                if push(robot, v, turn.turn_rate, change) >= MARGIN:
                    sides.append(Side(lead, speed, turn))
    return tuple(sides)


@lru_cache(maxsize=256)
def run_up_sides(robot: Robot, limits: Limits, speed: float) -> tuple[Side, ...]:
    """Return the ways to begin a run-up at `speed` (m/s): straight, then turn as fast as the ball allows."""
    sides = []
    for v in sorted({*_RUN_UP_SPEEDS, speed}):
        lead = _straight(limits, speed, v)
        for change in _RUN_UP_CHANGES:
            turns = (TurnDriving(v, change, rate * limits.w) for rate in _RUN_UP_RATES)
            kept = (turn for turn in turns if push(robot, v, turn.turn_rate, change) >= MARGIN)
            sides += [Side(lead, speed, turn) for turn in itertools.islice(kept, 1)]
    return tuple(sides)


@lru_cache(maxsize=256)
def release_sides(robot: Robot, limits: Limits) -> tuple[Side, ...]:
    """Return the ways to end at full speed with the ball: turn at a constant speed, then run up straight."""
    turns = (TurnDriving(v, 0.0, rate * limits.w) for v in _RELEASE_SPEEDS for rate in _RATES[::2])
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
        for v in sorted({*_EXIT_SPEEDS, speed} - {0.0}):
            run = _straight(limits, v, speed)
            for change in _EXIT_CHANGES:
                turn = TurnDriving(v, change, rate * limits.w)
                if push(robot, v, turn.turn_rate, -change) >= MARGIN:
                    sides.append(Side(run, speed, turn))
    return tuple(sides)


def _straight(limits: Limits, v1: float, v2: float) -> float:
    """Return the shortest distance in m in which the speed goes from v1 to v2 (m/s)."""
    return abs(v2 * v2 - v1 * v1) / (2.0 * (limits.a if v2 > v1 else limits.brake))
