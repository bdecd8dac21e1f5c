"""The same drives in several sources count once: tables given twice, recordings that overlap.

Stamps may be shifted, which changes the last digits of interpolated numbers. A recording that began
during a drive holds only its end.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from ator_ros.actions.goal_variables import direct_name
from ator_ros.experience.table import goal_variables_of_columns, object_columns, objects_of_columns
from ator_ros.geometry import BoolArray, IntArray

_SAME_NUMBER = 1e-4  # m, rad, m/s or rad/s between numbers of the same drive
_SAME_DURATION = 1e-3  # s, likewise
# The end of a drive is compared with states that are interpolated between rows at 10 Hz.
_SAME_STATE = 0.02  # m, rad, m/s or rad/s
_MOVING = 0.05  # m/s above which a drive may be the end of another one
_START = ("x", "y", "v", "w", "vy", "hold", "success")
_GOAL = ("xg", "yg", "speedg")


def without_repeats(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table without the episodes that repeat another one.

    Of those that equal, the first remains. Of a drive and its end, the drive remains.
    """
    if rows.empty:
        return rows
    codes, _ = pd.factorize(rows["action"])
    names = np.column_stack([codes, rows["episode"]])
    begins = np.flatnonzero(np.append(True, (names[1:] != names[:-1]).any(axis=1)))
    starts = rows.iloc[begins].reset_index(drop=True)
    once = _first_of_equals(starts, codes[begins])
    lengths = np.diff(np.append(begins, len(rows)))
    drives = [slice(begin, begin + length) for begin, length in zip(begins, lengths, strict=True)]
    once[_ends_of_others(rows, starts, drives, once)] = False
    kept = np.repeat(once, lengths)
    return rows if kept.all() else rows[kept].reset_index(drop=True)


def _first_of_equals(starts: pd.DataFrame, actions: IntArray) -> BoolArray:
    """Return which episodes equal no earlier one, by their first rows and numbers of actions."""
    declared = map(direct_name, goal_variables_of_columns(starts.columns))
    names = [*_START, *_GOAL, *object_columns(objects_of_columns(starts.columns)), *declared]
    numbers = starts[names].to_numpy(dtype=float)
    angles = starts[["yaw", "yawg"]].to_numpy(dtype=float)
    columns = np.column_stack([actions, numbers, np.cos(angles), np.sin(angles)])
    durations = starts["duration"].to_numpy(dtype=float) / _SAME_DURATION
    scaled = np.column_stack([np.nan_to_num(columns) / _SAME_NUMBER, durations])
    _, firsts = np.unique(np.round(scaled), axis=0, return_index=True)
    firsts.sort()  # rounding may separate equals: the rest is compared
    pairs = cKDTree(scaled[firsts]).query_pairs(1.0, p=np.inf, output_type="ndarray")
    once = np.full(len(starts), False)
    once[firsts] = True
    once[firsts[pairs[:, 1]]] = False
    return once


def _ends_of_others(
    rows: pd.DataFrame, starts: pd.DataFrame, drives: list[slice], once: BoolArray
) -> list[int]:
    """Return the episodes that are the end of a longer one; `drives` are the rows of each."""
    if len(rows) == len(starts):
        return []
    yaw = rows["yaw"].to_numpy(dtype=float)
    places = rows[["x", "y", "v"]].to_numpy(dtype=float)
    states = np.column_stack([places, np.cos(yaw), np.sin(yaw)])
    remaining = rows["time_to_go"].to_numpy(dtype=float)
    goals = np.round(starts[["xg", "yg", "yawg"]].to_numpy(dtype=float) / _SAME_STATE)
    goal_of = np.unique(goals, axis=0, return_inverse=True)[1].ravel()
    moving = once & (starts["v"].abs() > _MOVING).to_numpy()
    found = []
    for end in np.flatnonzero(moving).tolist():
        begin = drives[end].start
        for other in np.flatnonzero(once & (goal_of == goal_of[end])).tolist():
            part = drives[other]
            then = remaining[begin]
            if remaining[part.stop - 1] < then < remaining[part.start]:
                times = remaining[part][::-1]
                state = [np.interp(then, times, column[::-1]) for column in states[part].T]
                if np.abs(states[begin] - state).max() < _SAME_STATE:
                    found.append(end)
                    break
    return found
