"""The parts of an observed drive, which speeds separate: a turn, a straight and another turn."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray

if TYPE_CHECKING:
    import pandas as pd

_TURN_DISTANCE = 0.05  # m; within this of the start or end of a drive, the robot turns
_LONGEST_GAP = 0.5  # s between odometry messages


class DriveParts(NamedTuple):
    """The parts of a drive; NaN where unknown. The rest of its duration is the straight."""

    first_turn: float = math.nan  # s; until the robot has driven 5 cm
    last_turn: float = math.nan  # s; from when 5 cm of the drive are left
    driven: float = math.nan  # m; how far forward less how far backward


def parts_of_drive(times: FloatArray, speeds: FloatArray, duration: float) -> DriveParts:
    """Return the parts of a drive of `duration` s, during which speeds (n,) in m/s were observed.

    `times` (n,) are in s since its start. All parts are NaN if odometry has a gap, and turns if the
    drive is shorter than 10 cm.
    """
    if np.diff(times, append=duration).max() > _LONGEST_GAP:
        return DriveParts()
    # Integrated speeds: localization may move the position of a robot that stands.
    steps = speeds[:-1] * np.diff(times)
    driven = np.append(0.0, np.cumsum(steps))
    total = float(driven[-1])
    left = total - driven
    begun = times[np.abs(driven) > _TURN_DISTANCE]
    ends = times[np.abs(left) > _TURN_DISTANCE]
    if not len(begun) or not len(ends) or begun[0] > ends[-1]:
        return DriveParts(driven=total)
    first_turn = float(begun[0])
    last_turn = duration - float(ends[-1])
    return DriveParts(first_turn, last_turn, total)


def part_times(starts: pd.DataFrame) -> FloatArray:
    """Return the times of the parts of drives, in s, shape (n, 3); NaN where unknown.

    The parts are the first turn, the straight and the last turn. `starts` are the first rows of n
    episodes of an experience table.
    """
    first = starts["first_turn"].to_numpy(dtype=float)
    last = starts["last_turn"].to_numpy(dtype=float)
    straight = starts["duration"].to_numpy(dtype=float) - first - last
    parts = np.stack([first, straight, last], axis=1)
    parts[(parts < 0.0).any(axis=1)] = np.nan
    return parts
