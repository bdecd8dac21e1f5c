"""Reads off an action's episodes how it drives: limits from odometry, the rest from durations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd

from ator_ros.geometry import FloatArray
from ator_ros.performance.derived import Geometry
from ator_ros.performance.direct import DIRECT_VARIABLES
from ator_ros.performance.driving import LEVELS, DrivingStyle
from ator_ros.robot.description import Limits, Robot

_EPISODES = 300  # more don't change what is read off, and take longer
_GREATEST, _OFTEN = 0.995, 0.95  # quantiles that count as the greatest speed and acceleration
_BACKWARD = (-0.1, 0.01)  # m/s, and the share of rows that are faster backward in an action that drives so
_STEADY = 0.08  # m/s^2 up to which the speed counts as steady
_SEEN = 10  # samples from which on a turn rate counts
_RUNS: tuple[float | None, ...] = (0.0, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, None)
_PASSINGS = (0.0, 0.2, 0.3, 0.35, 0.4, 0.5)
_BETTER = 0.97  # share of the error that a change of run or passing must leave at most


def observed_driving(rows: pd.DataFrame, robot: Robot) -> DrivingStyle:
    """Return how an action drives.

    Parameters
    ----------
    rows : pandas.DataFrame
        Its rows of an experience table.
    robot : Robot
        Its limits hold where too little was seen.
    """
    rows = rows[rows["episode"].isin(rows["episode"].unique()[:_EPISODES])]
    seen = from_odometry(rows, robot)
    starts = rows[(rows["t"] == 0.0) & rows["success"]]
    return _best_approach(seen, starts, robot)


def from_odometry(rows: pd.DataFrame, robot: Robot) -> DrivingStyle:
    """Return limits, whether the action drives backward, and its turn rates by speed."""
    v, w = rows["v"].to_numpy(dtype=float), rows["w"].to_numpy(dtype=float)
    time, episode = rows["t"].to_numpy(dtype=float), rows["episode"].to_numpy()
    after = np.flatnonzero((episode[1:] == episode[:-1]) & (time[1:] > time[:-1])) + 1
    step = time[after] - time[after - 1]
    change = (np.abs(v[after]) - np.abs(v[after - 1])) / step
    base = robot.limits
    greatest, turning = _quantile(np.abs(v), _GREATEST, base.v), _quantile(np.abs(w), _GREATEST, base.w)
    limits = Limits(
        greatest,
        turning,
        _quantile(change[change > 0.0], _OFTEN, base.a),
        _quantile(-change[change < 0.0], _OFTEN, base.brake),
        _quantile(np.abs(w[after] - w[after - 1]) / step, _OFTEN, base.aw),
    )
    speed = 0.5 * np.abs(v[after] + v[after - 1]) / greatest
    level = np.clip((speed * LEVELS).astype(int), 0, LEVELS - 1)
    rates = np.abs(w[after]) / turning
    steady, braking = (
        _envelope(level[which], rates[which]) for which in (np.abs(change) < _STEADY, change < -_STEADY)
    )
    backward = bool(np.mean(v < _BACKWARD[0]) > _BACKWARD[1])
    return DrivingStyle(limits, backward, 0.0, 0.0, steady, braking)


def _quantile(values: FloatArray, share: float, otherwise: float) -> float:
    """Return a quantile, but what the base can do where (almost) nothing was seen."""
    found = float(np.quantile(values, share)) if len(values) >= _SEEN else 0.0
    return found if found > 0.05 * otherwise else otherwise


def _envelope(level: FloatArray, rates: FloatArray) -> tuple[float, ...]:
    """Return the greatest rate at each level of speed; what goes at a lower speed goes at a higher one."""
    greatest = [
        float(np.quantile(rates[level == number], 0.98)) if np.sum(level == number) >= _SEEN else 0.0
        for number in range(LEVELS)
    ]
    rising = np.maximum.accumulate(np.minimum(greatest, 1.0))
    seen = rising[rising > 0.0]
    rising[rising == 0.0] = seen.min() if len(seen) else 1.0
    return tuple(round(float(share), 3) for share in rising)


def _best_approach(driving: DrivingStyle, starts: pd.DataFrame, robot: Robot) -> DrivingStyle:
    """Choose run and passing with which the times of paths tell the durations best."""
    best, least = driving, _error(driving, starts, robot)
    for _ in range(2):
        for tried in (
            [dataclasses.replace(best, run=run) for run in _RUNS],
            [dataclasses.replace(best, passing=passing) for passing in _PASSINGS],
        ):
            errors = [_error(other, starts, robot) for other in tried]
            if min(errors) < _BETTER * least:
                best, least = tried[int(np.argmin(errors))], min(errors)
    return best


def _error(driving: DrivingStyle, starts: pd.DataFrame, robot: Robot) -> float:
    """Return the mean error in s of the durations as a linear function of the times of paths."""
    direct = {name: starts[name].to_numpy(dtype=float) for name in DIRECT_VARIABLES}
    times = Geometry(direct, robot, driving).path.time
    table = np.column_stack([np.ones(len(times)), times])
    durations = starts["duration"].to_numpy(dtype=float)
    weights = np.linalg.lstsq(table, durations, rcond=None)[0]
    return float(np.mean(np.abs(durations - table @ weights)))
