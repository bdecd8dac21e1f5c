"""Rows of experience from files that anybody may have written: refused unless they make sense."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ator_ros.actions.goal_variables import direct_name
from ator_ros.experience.columns import (
    LARGEST,
    goal_variables_of_columns,
    object_columns,
    objects_of_columns,
)
from ator_ros.experience.errors import ExperienceError
from ator_ros.files import is_name
from ator_ros.geometry import FloatArray
from ator_ros.printable import quoted

_NAME = "a name of letters, digits and _"


class _Rule(NamedTuple):
    """What the numbers of a column are to be, in words and in bounds; `whole`: without a fraction."""

    expected: str
    low: float
    high: float = LARGEST
    whole: bool = False
    unknown: bool = False  # may be NaN


_PLACE = _Rule("finite numbers up to 1e9", -LARGEST)
_NUMBER_OR_NAN = _Rule("finite numbers up to 1e9, or NaN", -LARGEST, unknown=True)
_TIME = _Rule("times in s from 0", 0.0)
_ERROR = _Rule("numbers from 0, or NaN", 0.0, unknown=True)
_RULES = {
    "episode": _Rule("whole numbers from 0 to 1e7", 0.0, 1e7, whole=True),
    **dict.fromkeys(("t", "time_to_go", "duration"), _TIME),
    **dict.fromkeys(("x", "y", "yaw", "v", "w", "xg", "yg", "yawg"), _PLACE),
    "speedg": _Rule("speeds in m/s from 0", 0.0),
    "hold": _Rule("0 or 1", 0.0, 1.0, whole=True),
    "success": _Rule("true or false", 0.0, 1.0, whole=True),
    **dict.fromkeys(("position_error", "heading_error"), _ERROR),
}
_TRUTHS = ("hold", "success")
"""Columns that may be of a type for true and false."""


def checked_rows(source: Path | str, frame: pd.DataFrame, action_set: object) -> pd.DataFrame:
    """Return the rows with plain types, if models can be learned from them and saved under their names.

    Parameters
    ----------
    source : Path or str
        Where they were read, for the message.
    frame : pandas.DataFrame
        With the columns of `columns.columns`, of any types.
    action_set : object
        Name of the set that the actions are of.

    Raises
    ------
    ExperienceError
        There are no rows, or a value is not what its column holds.
    """
    if not is_name(action_set):
        raise ExperienceError(f"{source}: action_set: expected {_NAME}, got {quoted(action_set)}")
    if frame.empty:
        raise ExperienceError(f"{source}: expected rows of experience, found none")
    names = frame["action"].astype(object)
    for name in names.unique():
        if not is_name(name):
            raise ExperienceError(f"{source}: action: expected {_NAME}, got {quoted(name)}")
    objects = dict.fromkeys(object_columns(objects_of_columns(frame.columns)), _NUMBER_OR_NAN)
    declared = dict.fromkeys(map(direct_name, goal_variables_of_columns(frame.columns)), _NUMBER_OR_NAN)
    rules = {**_RULES, **objects, **declared}
    checked: dict[str, object] = {name: _numbers(source, frame[name], rule) for name, rule in rules.items()}
    checked |= {"action": names, "reason": frame["reason"].astype(object)}
    plain = {"episode": np.int32, "hold": np.int8, "success": bool}
    return pd.DataFrame({name: checked[name] for name in frame.columns}).astype(plain)


def _numbers(source: Path | str, column: pd.Series, rule: _Rule) -> FloatArray:
    """Return the numbers of a column, which may be of any type that holds numbers."""
    where = f"{source}: {column.name}: expected {rule.expected}"
    truths = pd.api.types.is_bool_dtype(column)
    if not pd.api.types.is_numeric_dtype(column) or (truths and column.name not in _TRUTHS):
        raise ExperienceError(f"{where}, got the type {column.dtype}")
    try:
        values: FloatArray = column.to_numpy(dtype=float, na_value=np.nan)
    except (TypeError, ValueError) as error:  # complex numbers, say
        raise ExperienceError(f"{where}, got the type {column.dtype}") from error
    with np.errstate(invalid="ignore"):
        good = (values >= rule.low) & (values <= rule.high)
        good &= (values % 1.0 == 0.0) | (not rule.whole)
    wrong = np.flatnonzero(~(good | (np.isnan(values) & rule.unknown)))
    if wrong.size:
        raise ExperienceError(f"{where}, got {values[wrong[0]]:g} in row {wrong[0]}")
    return values
