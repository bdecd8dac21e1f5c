"""Times of turn-straight-turn paths at the limits that were observed of a base: features for any action.

Nothing here knows an action's plan. A path turns, drives straight and turns again, forward or backward, to
either side, while the speed changes evenly or not at all; of many such paths the fastest counts. How fast the
action turns and drives, whether it ever drives backward, and how it comes up to what it holds at the end is
read off its odometry (`ator_ros.performance.observing`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np

from ator_ros.compiled import in_shares
from ator_ros.geometry import FloatArray
from ator_ros.motion.durations import rates_of, turn_parts
from ator_ros.motion.families import Motions
from ator_ros.performance.compiled_paths import Entry, Exit, PathRules
from ator_ros.performance.driving import LEVELS, DrivingStyle
from ator_ros.performance.path_search import PathWays, fastest_ways
from ator_ros.performance.tree.nodes import IntArray

_SHARE = 12  # ends that one core takes at least: some 60 microseconds
_ANGLES = 257  # of a table of turns, from 0 to a full turn
_MOMENTS = 96  # at which a turn is summed up
_RATES = 12  # tables, of equally spaced turn rates up to the limit
_SLOWEST = 3  # twelfths of the turn rate below which turning is no way to drive
_SIDES = (1, -1)
_CHANGES = (-1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0)  # of speed in a turn, in shares of the limits
_GAINS = (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0)  # the same where the base never drives backward
_LEADS = (0.1, 0.2, 0.35, 0.55)  # speeds to reach before the first turn, in shares of the limit
_RUN_SPEEDS = (0.0, 0.3, 0.6, 0.9)  # at which a run of given length begins, from least to greatest
_ARRIVALS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.55, 0.75, 0.95)  # the same in shares of the limit, other runs
_LOSSES = (0.5, 0.9)  # of speed in the last turn before them
_TIGHT = 0.1  # m, radius of the tightest turn at a steady speed where the base never drives backward


@lru_cache(maxsize=64)
def turn_table(rate: float, aw: float) -> FloatArray:
    """Return what turns do, by angle, at up to `rate` (rad/s), from and to no rotation.

    Returns
    -------
    ndarray, shape (_ANGLES, 5)
        Time (s), and the integrals over it of cosine, sine, time x cosine and time x sine of the heading:
        with speed v at the start and acceleration a, v times the first two plus a times the last two is the
        way.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, _ANGLES)[:, None]
    ramp, steady = turn_parts(angles, rate, aw)
    whole, peak = 2.0 * ramp + steady, aw * ramp
    time = whole * (np.arange(_MOMENTS) + 0.5) / _MOMENTS
    middle = 0.5 * peak * ramp + peak * (time - ramp)
    early, late = 0.5 * aw * time * time, angles - 0.5 * aw * (whole - time) ** 2
    heading = np.where(time < ramp, early, np.where(time > whole - ramp, late, middle))
    parts = (np.cos(heading), np.sin(heading), time * np.cos(heading), time * np.sin(heading))
    return np.column_stack([whole, *(part.mean(axis=1, keepdims=True) * whole for part in parts)])


@lru_cache(maxsize=32)
def _tables(rate: float, aw: float) -> FloatArray:
    return np.stack([turn_table(rate * (number + 1) / _RATES, aw) for number in range(_RATES)])


@lru_cache(maxsize=64)
def _ways(driving: DrivingStyle, *, holding: bool) -> PathWays:
    """Return the ways to drive."""
    full = _RATES - 1
    if driving.backward:
        begins = [(-1.0, gain, full) for gain in _CHANGES]
    else:
        begins = [(-1.0, gain, full) for gain in _GAINS]
        begins += [(lead, 0.0, _number(driving.steady, lead)) for lead in _LEADS]
    if driving.run is None and holding:
        ends = [(speed, 0.0, _number(driving.steady, speed)) for speed in _ARRIVALS]
        ends += [(speed, loss, _number(driving.braking, speed)) for speed in _ARRIVALS for loss in _LOSSES]
    else:
        speeds = _RUN_SPEEDS if holding and driving.run else (0.0,)
        changes = _CHANGES if driving.backward else (-0.5, 0.0, 0.5, 1.0)
        ends = [(speed, change, full) for speed in speeds for change in changes]
    entries = [
        Entry(side, direction, *begin)
        for direction in ((1, -1) if driving.backward else (1,))
        for begin in begins
        for side in _SIDES
        if begin[-1] >= _SLOWEST - 1
    ]
    exits = [Exit(side, *end) for end in sorted(ends) for side in _SIDES if end[-1] >= _SLOWEST - 1]
    leads = _changes([(entry.direction, entry.lead) for entry in entries])
    runs = _changes([leave.arrival if driving.run is None and holding else 0.0 for leave in exits])
    rows = [
        np.array(ways, dtype=float).reshape(-1, len(kind._fields))
        for ways, kind in ((entries, Entry), (exits, Exit))
    ]
    return PathWays(rows[0], leads, rows[1], runs)


def _changes(values: Sequence[object]) -> IntArray:
    """Return where values differ from those before them, and where they end."""
    first = [index for index, value in enumerate(values) if index == 0 or value != values[index - 1]]
    return np.array([*first, len(values)], dtype=np.intp)


def _number(shares: tuple[float, ...], speed: float) -> int:
    """Return which table of turns holds at a speed, a share of the limit; -1 for none."""
    return round(_RATES * min(shares[min(int(speed * LEVELS), LEVELS - 1)], 1.0)) - 1


def path_times(ends: FloatArray, driving: DrivingStyle, *, hold: float, holding: bool) -> Motions:
    """Return time and angle of the fastest paths.

    Parameters
    ----------
    ends : ndarray, shape (n, 5)
        Where the axle shall come, ahead and to the left in m, the turn to its heading there in rad, and the
        speeds at start and goal in m/s.
    driving : DrivingStyle
        How the action drives.
    hold : float
        Distance in m from the axle to what the robot holds.
    holding : bool
        Whether it shall hold something at the goal.

    Returns
    -------
    Motions
        Infinite times where none of the paths leads to the goal.
    """
    rates = rates_of(driving.limits)
    run = (-1.0 if driving.run is None else driving.run) if holding else 0.0
    passing = driving.passing if holding else 0.0
    rules = PathRules(rates, run, not driving.backward, passing, hold, _TIGHT * rates.w)
    times, turns = np.full(len(ends), np.inf), np.zeros(len(ends))
    ways = _ways(driving, holding=holding)
    if not (len(ways.entries) and len(ways.exits)):  # it turns too slowly at all speeds
        return Motions(times, turns)
    search = partial(fastest_ways, ends, ways, rules, _tables(rates.w, rates.aw), times, turns)
    in_shares(search, len(ends), _SHARE)
    return Motions(times, turns)
