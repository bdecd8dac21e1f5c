"""Rows of experience from files that anybody may have written: refused unless they make sense."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from ator_ros.experience.errors import ExperienceError
from ator_ros.files import is_name

_UNKNOWN_AS_NAN = ("ball_x", "ball_y", "position_error", "heading_error")
_FINITE = ("t", "x", "y", "yaw", "v", "w", "xg", "yg", "yawg", "speedg", "time_to_go", "duration")
_RULES: dict[str, tuple[str, Callable[[pd.Series], pd.Series]]] = {
    "action": ("a name of letters, digits and _", lambda values: values.map(is_name)),
    "episode": ("whole numbers from 0", lambda values: (values >= 0) & (values % 1 == 0)),
    "hold": ("0 or 1", lambda values: values.isin([0, 1])),
    "success": ("true or false", lambda values: values.isin([True, False])),
    **dict.fromkeys(_FINITE, ("finite numbers", lambda values: pd.Series(np.isfinite(values)))),
    **dict.fromkeys(_UNKNOWN_AS_NAN, ("finite numbers or NaN", lambda values: ~np.isinf(values))),
    **dict.fromkeys(
        ("t", "time_to_go", "duration"), ("times in s from 0", lambda v: np.isfinite(v) & (v >= 0.0))
    ),
}
"""What the values of a column are to be, in words and as a test of each."""


def check_rows(source: Path | str, frame: pd.DataFrame, action_set: object) -> None:
    """Check that a model can be learned from these rows and saved under the names they give.

    Parameters
    ----------
    source : Path or str
        Where they were read, for the message.
    frame : pandas.DataFrame
        With the columns of `table.COLUMNS`.
    action_set : object
        Name of the set that the actions are of.

    Raises
    ------
    ExperienceError
        There are no rows, or a value is not what its column holds.
    """
    if not is_name(action_set):
        raise ExperienceError(
            f"{source}: action_set: expected a name of letters, digits and _, got {action_set!r}"
        )
    if frame.empty:
        raise ExperienceError(f"{source}: expected rows of experience, found none")
    for column, (expected, holds) in _RULES.items():
        values = frame[column]
        if column != "action" and not pd.api.types.is_numeric_dtype(values):
            raise ExperienceError(f"{source}: {column}: expected {expected}, got the type {values.dtype}")
        wrong = np.flatnonzero(~holds(values).to_numpy(dtype=bool))
        if wrong.size:
            raise ExperienceError(
                f"{source}: {column}: expected {expected}, got {values.iloc[wrong[0]]!r} in row {wrong[0]}"
            )
