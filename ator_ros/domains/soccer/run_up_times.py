"""How long a run-up to a shot takes: straight, one turn, straight on until the ball is let go and rolls in.

A shot may go anywhere between the posts, in any direction. Whether a tight enough turn leads into the goal
decides between one second and six. A few ideal motions to fixed places cannot show that. The search is
compiled, since each situation looks at hundreds of run-ups.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from ator_ros.compiled import inlined, parallel_for, unlocked
from ator_ros.domains.soccer.field import BALL, field_of
from ator_ros.domains.soccer.planned.holding import (
    LARGEST_TURN,
    MOST_GAINED,
    RUN_UP_RATES,
    fastest_turn,
    gain_of,
    held_limits,
)
from ator_ros.domains.soccer.planned.planned_action import planned_limits
from ator_ros.domains.soccer.planned.shoot import ROOM, SLANT, roll_of
from ator_ros.geometry import FloatArray
from ator_ros.motion.displacements import TurnDriving, displacement_table
from ator_ros.motion.durations import Rates, change_distance, forward_time, rates_of, turn_time
from ator_ros.performance.derived import wrapped
from ator_ros.robot.description import Limits, Robot

_ANGLES = 151
"""Entries of a table: turns to the left by 0 to `LARGEST_TURN`."""
_LEADS = (0.0, 0.4, 1.0)
"""By how much in m the straight before the turn may be longer than its change of speed needs."""


class _HeldTurns(NamedTuple):
    """Where turns with the ball lead, driven as fast as it allows."""

    table: FloatArray  # (speeds, _ANGLES, gains, 2): forward and leftward from the start, of left turns, m
    rates: FloatArray  # (speeds, gains): greatest turn rate, rad/s
    gains: FloatArray  # change of speed, m/s^2
    step: float  # between two start speeds, m/s; the first is 0


class _ShotSetting(NamedTuple):
    """Robot, ball and goal: lengths in m, decelerations in m/s^2, `roll` as in `roll_of`."""

    hold: float
    reach: float
    radius: float
    rolling: float
    braking: float
    half_width: float
    depth: float
    roll: float


@unlocked
def _fastest_run_ups(
    starts: FloatArray, speeds: FloatArray, slants: FloatArray, turns: _HeldTurns, setting: _ShotSetting,
    rates: Rates, result: FloatArray, first: int, end: int,
) -> None:  # fmt: skip
    """Write the time in s until the ball is in the goal, infinite where no run-up leads there; NaN for NaN.

    Parameters
    ----------
    starts : ndarray, shape (4, n)
        As for `run_up_times`.
    speeds : ndarray, shape (m,)
        At which turns may begin besides the speed of the start, in m/s.
    slants : ndarray, shape (k, 4)
        Headings in rad in which the ball may be sent, their cosine, sine and tangent.
    first, end : int
        The situations to search in.
    """
    for at in range(first, end):
        x, y, yaw = starts[0, at], starts[1, at], starts[2, at]
        if not math.isfinite(x + y + yaw + starts[3, at]):
            result[at] = math.nan
            continue
        v, best = min(max(starts[3, at], 0.0), rates.v), math.inf
        all_round = _least_time((x, y, yaw, v), setting, rates) + turn_time(math.pi, rates.w, rates.aw)
        for lead in _LEADS:
            if lead > 0.0 and best < all_round:
                break  # a longer lead saves at most tenths of a second where no detour is made
            for entry in range(-1, len(speeds)):
                begin = v if entry < 0 else speeds[entry]
                if entry >= 0 and begin == v:
                    continue
                length = change_distance(v, begin, rates) + lead
                straight = forward_time(length, v, begin, rates)
                start = (x + length * math.cos(yaw), y + length * math.sin(yaw), yaw, begin)
                if straight + _least_time(start, setting, rates) < best:
                    found = _fastest_turn(start, best - straight, slants, turns, setting, rates)
                    best = min(best, straight + found)
        result[at] = best


@inlined
def _least_time(start: tuple[float, float, float, float], setting: _ShotSetting, rates: Rates) -> float:
    """Return a lower bound in s of the time from a start until the ball is at the line."""
    way, speed = max(-setting.hold - start[0], 0.0), start[3]
    gained = (rates.v * rates.v - speed * speed) / (2.0 * rates.a)
    if way <= gained:
        return (math.sqrt(speed * speed + 2.0 * rates.a * way) - speed) / rates.a
    return (rates.v - speed) / rates.a + (way - gained) / rates.v


@inlined
def _fastest_turn(
    start: tuple[float, float, float, float], most: float, slants: FloatArray, turns: _HeldTurns,
    setting: _ShotSetting, rates: Rates,
) -> float:  # fmt: skip
    """Return the time in s of the fastest turn and shot from a start, infinite unless it is below `most`."""
    x, y, yaw, speed = start
    row = min(int(speed * (1.0 / turns.step) + 0.5), len(turns.table) - 1)
    ahead, aside = math.cos(yaw), math.sin(yaw)
    best = most
    for number in range(2 * len(slants)):
        if number == len(slants) and turn_time(math.pi, rates.w, rates.aw) >= best:
            break
        slant, cos, sin, tan = slants[number % len(slants)]
        angle = wrapped(slant - yaw)
        if number >= len(slants):
            angle -= math.copysign(2.0 * math.pi, angle)  # the other way round
        size, side = abs(angle), math.copysign(1.0, angle)
        if not size < LARGEST_TURN:
            continue
        widest = setting.half_width - (setting.reach + ROOM) / cos
        aim = y + setting.hold * sin - (x + setting.hold * cos) * tan
        # By how much farther to the left the ball crosses the line for each m of a displacement.
        forward_aim, left_aim = aside - ahead * tan, side * (ahead + aside * tan)
        place = size * ((_ANGLES - 1) / LARGEST_TURN)
        low = min(int(place), _ANGLES - 2)
        for gain in range(len(turns.gains)):
            before, after = turns.table[row, low, gain], turns.table[row, low + 1, gain]
            forward = before[0] + (place - low) * (after[0] - before[0])
            left = before[1] + (place - low) * (after[1] - before[1])
            if abs(aim + forward_aim * forward + left_aim * left) > widest:
                continue
            turning = turn_time(size, turns.rates[row, gain], rates.aw)
            if turning >= best:
                continue
            to_x = x + ahead * forward - aside * side * left
            to_y = y + aside * forward + ahead * side * left
            reached = min(speed + turns.gains[gain] * turning, rates.v)
            best = min(best, turning + _shot(to_x, to_y, cos, sin, reached, best - turning, setting, rates))
    return best if best < most else math.inf


@inlined
def _shot(
    x: float, y: float, cos: float, sin: float, speed: float, most: float, setting: _ShotSetting, rates: Rates
) -> float:
    """Return the time in s from the beginning of the straight until the ball is in the goal.

    It is infinite where the robot is too near the line or would touch the goal, as in `release`, and where
    the ball would take more than `most` (s) even at full speed.
    """
    way = (setting.radius - x - setting.hold * cos) / cos
    if way < 0.0 or way * (1.0 / rates.v) > most:
        return math.inf
    gaining = (way - setting.roll * speed * speed) / (1.0 + 2.0 * setting.roll * rates.a)
    pushed = max(gaining, way - setting.roll * rates.v * rates.v, 0.0)
    released = min(math.sqrt(speed * speed + 2.0 * rates.a * pushed), rates.v)
    stop = pushed + released * released / (2.0 * setting.braking)
    inside = setting.depth - setting.reach - (x + stop * cos)
    if min(inside, setting.half_width - setting.reach - abs(y + stop * sin)) < ROOM:
        return math.inf
    left = math.sqrt(max(released * released - 2.0 * setting.rolling * (way - pushed), 0.0))
    time: float = forward_time(pushed, speed, released, rates) + (released - left) / setting.rolling
    return time


_HEADINGS: FloatArray = np.linspace(-SLANT, SLANT, 25)
_SLANTS: FloatArray = np.column_stack((_HEADINGS, np.cos(_HEADINGS), np.sin(_HEADINGS), np.tan(_HEADINGS)))
_ENTRY_SHARES: FloatArray = np.array((0.0, 0.15, 0.35, 0.7))
_GAIN_SHARES = (*(step / 8 for step in range(8)), MOST_GAINED)
_SPEEDS = 51
_CHUNK = 12
"""Situations that one core takes at least: some 60 microseconds."""


def run_up_times(robot: Robot, starts: FloatArray) -> FloatArray:
    """Return how long run-ups with one turn take until the ball is in the goal, shape (n,), in s.

    Two turns, which the action also tries where the one is large, are not considered. It is infinite where no
    run-up leads into the goal.

    Parameters
    ----------
    starts : ndarray, shape (4, n)
        Pose of the axle in the frame of the goal's mouth (m, m, rad), x out of the field, and speed in m/s;
        the robot does not turn.

    Raises
    ------
    NoHolderError
        The robot holds nothing.
    """
    starts = np.ascontiguousarray(starts, dtype=float)
    limits, turns, setting = _tables(robot)
    times = np.empty(starts.shape[1])
    speeds = _ENTRY_SHARES * limits.v
    search = partial(_fastest_run_ups, starts, speeds, _SLANTS, turns, setting, rates_of(limits), times)
    parallel_for(search, len(times), _CHUNK)
    return times


@lru_cache(maxsize=8)
def _tables(robot: Robot) -> tuple[Limits, _HeldTurns, _ShotSetting]:
    """Return what plans may use of the limits with the ball, the turns that they allow, and the goal."""
    limits = planned_limits(robot, held_limits(robot, "a shot"))
    gains = np.array([share * gain_of(robot) for share in _GAIN_SHARES])
    speeds: FloatArray = np.linspace(0.0, limits.v, _SPEEDS)
    angles: FloatArray = np.linspace(0.0, LARGEST_TURN, _ANGLES)
    ways = [
        fastest_turn(robot, limits, float(v), float(change))
        or TurnDriving(float(v), float(change), RUN_UP_RATES[-1] * limits.w)  # loses the ball last
        for v in speeds
        for change in gains
    ]
    rates = np.array([way.turn_rate for way in ways]).reshape(_SPEEDS, len(gains))
    table = displacement_table(angles, ways, limits).reshape(_SPEEDS, len(gains), 2, _ANGLES)
    turns = _HeldTurns(np.ascontiguousarray(table.transpose(0, 3, 1, 2)), rates, gains, float(speeds[1]))
    field, ball = field_of(robot), robot.scene.objects[BALL]
    setting = _ShotSetting(
        robot.hold, robot.reach, ball.radius, ball.rolling_deceleration, robot.limits.brake,
        field.goal_width / 2.0, field.goal_depth, roll_of(robot),
    )  # fmt: skip
    return limits, turns, setting
