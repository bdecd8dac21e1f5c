"""The parts of an observed drive: a turn, a straight and another turn, which odometry's speeds separate."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ator_ros.geometry import FloatArray

_TURNS_WITHIN = 0.05  # m driven from the start, or left to the end, of a drive: there the robot turns
_LONGEST_GAP = 0.5  # s without odometry


class DriveParts(NamedTuple):
    """The parts of a drive; NaN where unknown. The rest of its duration is the straight."""

    first_turn: float = math.nan  # s; until the robot has driven 5 cm
    last_turn: float = math.nan  # s; from 5 cm before its end
    driven: float = math.nan  # m; how far forward less how far backward


def parts_of_drive(times: FloatArray, speeds: FloatArray, duration: float) -> DriveParts:
    """Return the parts of a drive of `duration` s, during which speeds (n,) in m/s were observed.

    `times` (n,) are in s since its start. Turns are unknown of drives shorter than 10 cm, and all parts if
    odometry has a gap.
    """
    if np.diff(times, append=duration).max() > _LONGEST_GAP:
        return DriveParts()
    # Integrated speeds: localization may move the position of a robot that stands.
    steps = speeds[:-1] * np.diff(times)
    driven = np.append(0.0, np.cumsum(steps))
    left = driven[-1] - driven
    begun, ends = times[np.abs(driven) > _TURNS_WITHIN], times[np.abs(left) > _TURNS_WITHIN]
    if not len(begun) or not len(ends) or begun[0] > ends[-1]:
        return DriveParts(driven=float(driven[-1]))
    return DriveParts(float(begun[0]), duration - float(ends[-1]), float(driven[-1]))
