"""How an action drives, estimated from odometry and durations.

The result has the limits of the action, its turns, and its approach of objects. A path turns,
drives straight and turns again. The episodes of an action show at which speeds it turns, and how
fast: a robot that pushes a ball turns more slowly while it brakes, and some servers turn on the
spot. The shapes of paths, whose times are features, consist of these turns
(`ator_ros.bases.differential.driving`).
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from ator_ros.bases.differential.driving import (
    RUNS,
    DrivingStyle,
    TurnRates,
    chosen_shapes,
    forward_shapes,
    free_shapes,
    plain_driving,
)
from ator_ros.bases.differential.durations import rates_of
from ator_ros.bases.differential.legs import ends_of, fastest_drives
from ator_ros.bases.differential.limits import GREATEST, LEAST, Limits
from ator_ros.bases.differential.shapes import Rules
from ator_ros.bases.direct import (
    DIRECT_VARIABLES,
    HOLD,
    NEAR_GOAL,
    XG,
    YAW,
    YAWG,
    YG,
    X,
    Y,
    direct_table,
)
from ator_ros.geometry import BoolArray, FloatArray, wrap_angles

if TYPE_CHECKING:
    from ator_ros.bases.differential.robot import DifferentialBase

_SPEED_QUANTILE = 0.995  # quantile of the speeds that counts as the greatest speed
# quantile of the accelerations that counts as the greatest; lower, as their noise is larger
_CHANGE_QUANTILE = 0.95
_LEAST_SAMPLES = 10  # rows for a quantile
_LEAST_SHARE = 0.05  # of the base's limit; smaller quantiles are noise, not limits
# An action drives backward if more than this share of its rows is below this speed.
_BACKWARD_SPEED = -0.1  # m/s
_BACKWARD_SHARE = 0.01
# share of the drives on the wrong side of the angle above which they are backward
_MOST_WRONG = 0.02
_TURNING = 0.1  # share of the greatest turn rate above which the robot turns
_LEAST_DRIVEN = 0.1  # m, forward minus backward; below this the direction of a drive is unknown
_SPEEDS: FloatArray = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0])
_CHANGES: FloatArray = np.array([-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0])
"""Speeds, and changes of speed, for which turn rates are kept; shares of the limits."""
# Turns are alike if their speeds are at most this much lower or higher, and their changes of speed
# differ by at most `_OTHER`; shares of the limits.
_SLOWER = 0.04
_FASTER = 0.02
_OTHER = 0.1
_FEWEST = 3  # alike turns, or drives, that show anything
_USUAL = 0.6  # quantile of the rates of alike turns
_RUN_LENGTHS = (0.0, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)  # m
_PASSINGS = (0.0, 0.2, 0.3, 0.35, 0.4, 0.5)  # m
_BETTER = 0.97  # share of the error that a change of run or passing must leave at most


def observed_driving(rows: pd.DataFrame, robot: DifferentialBase) -> DrivingStyle:
    """Return how an action drives.

    Where too little was observed, the limits of `robot` are assumed.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of the action in an experience table.
    robot : DifferentialBase
        The robot of the experience.
    """
    starts = rows[(rows["t"] == 0.0) & rows["success"]]
    if starts.empty:
        return plain_driving(robot.limits)
    above = backward_above(starts, robot)
    if not (rows["t"] > 0.0).any():  # records hold only the starts of episodes
        return dataclasses.replace(plain_driving(robot.limits), backward_above=above)
    limits = _observed_limits(rows, robot)
    holding = starts["hold"] > 0.5
    if np.mean(rows["v"] < _BACKWARD_SPEED) <= _BACKWARD_SHARE:
        turns = _turns(rows, limits)
        first = _rates(turns.start, turns.gain, turns)
        last = _rates(turns.end, turns.loss, turns)
        known = np.isfinite(starts[["position_error", "heading_error"]]).any()
        # all goals are for the hold, or all for the axle
        same_point = holding.all() or not holding.any()
        free_heading = bool(same_point and known["position_error"] and not known["heading_error"])
        shapes = forward_shapes(limits, first, last, free_heading=free_heading)
        if not shapes:  # the odometry shows no turns
            first = last = lambda speed, change: float(speed == change == 0.0)  # on the spot
            shapes = forward_shapes(limits, first, last, free_heading=free_heading)
        rules = Rules(rates_of(limits), math.nan, forward=True, free_heading=free_heading)
        hold = robot.hold if holding.any() else 0.0
        drives = chosen_shapes(shapes, rules, _ends(starts, robot), hold=hold)
        return DrivingStyle(limits, drives, forward=True, free_heading=free_heading)
    free = starts if holding.all() else starts[~holding]
    ends = _ends(free, robot)
    drives = chosen_shapes(
        free_shapes(limits),
        Rules(rates_of(limits)),
        ends,
        hold=0.0,
    )
    driving = DrivingStyle(limits, drives, backward_above=above)
    return _best_approach(driving, starts[holding], robot) if holding.any() else driving


def backward_above(starts: pd.DataFrame, robot: DifferentialBase) -> float:
    """Return the `angle_to_dest` in rad above which drives are backward.

    It is the border with the fewest drives on the wrong side, and pi if no angle separates forward
    from backward drives.

    Parameters
    ----------
    starts : pandas.DataFrame
        First rows of episodes of an experience table.
    robot : DifferentialBase
        The robot of the experience.
    """
    driven = starts["driven"].to_numpy(dtype=float)
    legs = _legs(starts)
    back = robot.hold * legs[HOLD]
    dx = legs[XG] - back * np.cos(legs[YAWG]) - legs[X]
    dy = legs[YG] - back * np.sin(legs[YAWG]) - legs[Y]
    distance = np.sqrt(dx * dx + dy * dy)
    used = (np.abs(driven) > _LEAST_DRIVEN) & (distance > NEAR_GOAL)
    to_goal = np.arctan2(dy, dx)
    angles = np.abs(wrap_angles(to_goal - legs[YAW]))[used]
    backward = driven[used] < 0.0
    order = np.argsort(angles)
    angles = angles[order]
    backward = backward[order]
    # Drives on the wrong side of each border: one border before each angle, one after all.
    moved_across = np.append(0, np.cumsum(1 - 2 * ~backward))
    wrong = moved_across + np.count_nonzero(~backward)
    border = int(np.argmin(wrong))
    enough_on_both_sides = _FEWEST <= border <= len(angles) - _FEWEST
    if not enough_on_both_sides or wrong[border] > _MOST_WRONG * len(angles):
        return math.pi
    return float(angles[border - 1 : border + 1].mean())


def _ends(starts: pd.DataFrame, robot: DifferentialBase) -> FloatArray:
    """Return both ends of the paths of the starts of episodes, see `fastest_paths`."""
    return ends_of(_legs(starts), robot.hold, robot.limits.aw)[0]


def _legs(starts: pd.DataFrame) -> FloatArray:
    """Return the direct variables of the starts of episodes."""
    return direct_table(
        {name: starts[name].to_numpy(dtype=float) for name in DIRECT_VARIABLES}
    ).table


def _observed_limits(rows: pd.DataFrame, robot: DifferentialBase) -> Limits:
    """Return the greatest speeds and accelerations.

    Glitches count as at most the bounds of `Limits`.
    """
    v, w, time, after = _series(rows)
    before = after - 1
    step = time[after] - time[before]
    speed = np.abs(v)
    change = (speed[after] - speed[before]) / step
    turn_change = np.abs(w[after] - w[before]) / step
    base = robot.limits
    observed = (
        _quantile(speed, _SPEED_QUANTILE, base.v),
        _quantile(np.abs(w), _SPEED_QUANTILE, base.w),
        _quantile(change[change > 0.0], _CHANGE_QUANTILE, base.a),
        _quantile(-change[change < 0.0], _CHANGE_QUANTILE, base.brake),
        _quantile(turn_change, _CHANGE_QUANTILE, base.aw),
    )
    return Limits(*np.clip(observed, LEAST, list(GREATEST.values())).tolist())


def _series(rows: pd.DataFrame) -> tuple[FloatArray, FloatArray, FloatArray, np.ndarray]:
    """Return v, w, time of all rows, and the numbers of rows that follow one of their episode."""
    v = rows["v"].to_numpy(dtype=float)
    w = rows["w"].to_numpy(dtype=float)
    time = rows["t"].to_numpy(dtype=float)
    episode = rows["episode"].to_numpy()
    follows = (episode[1:] == episode[:-1]) & (time[1:] > time[:-1])
    return v, w, time, np.flatnonzero(follows) + 1


def _quantile(values: FloatArray, share: float, otherwise: float) -> float:
    """Return a quantile, or the limit `otherwise` of the base if (almost) nothing was observed."""
    found = float(np.quantile(values, share)) if len(values) >= _LEAST_SAMPLES else 0.0
    return found if found > _LEAST_SHARE * otherwise else otherwise


class _Turns(NamedTuple):
    """The turns of an action as shares of its limits, arrays of shape (n,)."""

    start: FloatArray  # speed at the start of the turn
    end: FloatArray
    gain: FloatArray  # change of speed in the first half of the turn
    loss: FloatArray  # change of speed in the second half
    rate: FloatArray  # greatest turn rate
    full: BoolArray  # whether the turn is long enough for the greatest rate of the base


def _turns(rows: pd.DataFrame, limits: Limits) -> _Turns:
    """Return the turns: runs of rows with turn rates of one sign above `_TURNING`.

    Each also has the row before and the row after it, if these belong to its episode.
    """
    v, w, time, after = _series(rows)
    # (rows,): the row follows the previous one of its episode
    follows = np.zeros(len(v), dtype=bool)
    follows[after] = True
    turning = np.abs(w) > _TURNING * limits.w
    # (rows,): the row continues the turn of the previous one
    continues = np.zeros(len(v), dtype=bool)
    same_sign = w[1:] * w[:-1] > 0.0
    continues[1:] = follows[1:] & turning[1:] & turning[:-1] & same_sign
    # Index of the first and of the last row of each turn, shape (turns,).
    begins = np.flatnonzero(turning & ~continues)
    ends = np.flatnonzero(turning & ~np.append(continues[1:], False))
    # Include the neighboring rows of the same episode.
    is_followed = np.append(follows[1:], False)
    begins = np.where(follows[begins], begins - 1, begins)
    ends = np.where(is_followed[ends], ends + 1, ends)
    found = []
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        if end - begin < 3:  # too short for a change of speed
            continue
        part = slice(begin, end + 1)
        changes = np.diff(v[part]) / np.diff(time[part])
        half = max(2, len(changes) // 2)
        start = abs(v[begin]) / limits.v
        end_speed = abs(v[end]) / limits.v
        gain = _share_of_limit(np.median(changes[:half]), limits)
        loss = _share_of_limit(np.median(changes[-half:]), limits)
        rate = np.max(np.abs(w[part])) / limits.w
        angle = abs(np.trapezoid(w[part], time[part]))
        found.append((start, end_speed, gain, loss, rate, angle))
    columns = np.array(found, dtype=float).reshape(-1, 6).T
    starts, end_speeds, gains, losses, rates, angles = columns
    # rad in which the base reaches its turn rate and stops again
    full = angles > limits.w**2 / limits.aw
    return _Turns(
        starts,
        end_speeds,
        gains,
        losses,
        rates,
        full,
    )


def _share_of_limit(change: Any, limits: Limits) -> Any:
    """Return a change of speed as a share of the greatest acceleration or deceleration."""
    return change / (limits.a if change > 0.0 else limits.brake)


def _rates(speeds: FloatArray, changes: FloatArray, turns: _Turns) -> TurnRates:
    """Return the usual turn rate as a function of the speed and its change at one end of a turn.

    A rate at one speed is assumed at higher ones too, up to the first of `_SPEEDS` above the
    highest observed: rates between both are interpolated. A rate while the speed falls is assumed
    also while it falls less.
    """
    full = turns.full if turns.full.any() else ~turns.full
    speeds = speeds[full]
    changes = changes[full]
    rates = turns.rate[full]
    table = np.zeros((len(_CHANGES), len(_SPEEDS)))
    for at in np.ndindex(table.shape):
        faster = speeds - _SPEEDS[at[1]]
        other = np.abs(changes - _CHANGES[at[0]])
        alike = (faster >= -_SLOWER) & (faster <= _FASTER) & (other <= _OTHER)
        if np.count_nonzero(alike) >= _FEWEST:
            table[at] = np.quantile(rates[alike], _USUAL)
    highest = np.max(np.flatnonzero(table.any(axis=0)), initial=0)
    table = np.maximum.accumulate(table, axis=0)
    table = np.minimum(np.maximum.accumulate(table, axis=1), 1.0)
    table[:, highest + 2 :] = 0.0

    def rate(speed: float, change: float) -> float:
        at_speed = [np.interp(speed, _SPEEDS, each) for each in table]
        return float(np.interp(change, _CHANGES, at_speed))

    return rate


def _best_approach(
    driving: DrivingStyle,
    starts: pd.DataFrame,
    robot: DifferentialBase,
) -> DrivingStyle:
    """Choose run and passing with which the times of paths predict durations best."""
    shapes = free_shapes(driving.limits, RUNS)
    ends = _ends(starts, robot)

    def approaching(run: float) -> DrivingStyle:
        rules = Rules(rates_of(driving.limits), run)
        approaches = chosen_shapes(shapes, rules, ends, hold=robot.hold)
        return dataclasses.replace(driving, run=run, approaches=approaches)

    best = first = approaching(_RUN_LENGTHS[len(_RUN_LENGTHS) // 2])
    least = np.inf
    for _ in range(2):
        for tried in (
            [dataclasses.replace(best, run=run) for run in _RUN_LENGTHS],
            [dataclasses.replace(best, passing=passing) for passing in _PASSINGS],
        ):
            errors = [_error(other, starts, robot) for other in tried]
            if min(errors) < _BETTER * least:
                best = tried[int(np.argmin(errors))]
                least = min(errors)
    if best.run == first.run:  # its shapes are chosen already
        return best
    return dataclasses.replace(approaching(best.run), passing=best.passing)


def _error(driving: DrivingStyle, starts: pd.DataFrame, robot: DifferentialBase) -> float:
    """Return the mean error in s of the durations as a linear function of the times of paths."""
    times = fastest_drives(_legs(starts), driving, robot.hold, robot.limits.aw)[0]
    table = np.column_stack([np.ones(len(times)), times])
    durations = starts["duration"].to_numpy(dtype=float)
    weights = np.linalg.lstsq(table, durations, rcond=None)[0]
    return float(np.mean(np.abs(durations - table @ weights)))
