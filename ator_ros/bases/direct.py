"""The direct variables of a situation: estimated state and goal (paper, section 4.1)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import FloatArray

DIRECT_VARIABLES: dict[str, str] = {
    "x": "m",
    "y": "m",
    "yaw": "rad",
    "v": "m/s",
    "w": "rad/s",
    "vy": "m/s",
    "xg": "m",
    "yg": "m",
    "yawg": "rad",
    "speedg": "m/s",
    "hold": "",
}
"""Names and units of the direct variables. Poses are in the world frame.

x, y, yaw belong to the axle at the start, and so do the velocities: v forward, vy to the left, w
counter-clockwise. xg, yg are the goal of the axle (hold 0) or of the
object held in front (hold 1); yawg and speedg are heading and forward speed there. Goal variables
that an action declares follow as NAMEg.
"""

X, Y, YAW, V, W, VY, XG, YG, YAWG, SPEEDG, HOLD = range(len(DIRECT_VARIABLES))
"""Rows of a table of direct variables."""

Direct = Mapping[str, Any]


class DirectTable(Mapping[str, FloatArray]):
    """Direct variables of n situations by name, each an array of shape (n,).

    Attributes
    ----------
    names : tuple of str
        All DIRECT_VARIABLES, then the declared goal variables, sorted.
    table : array of float, shape (len(names), n)
        Each variable is a row.
    """

    def __init__(self, names: tuple[str, ...], table: FloatArray) -> None:
        self.names = names
        self.table = table

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self.names:
            raise KeyError(name)
        return np.asarray(self.table[self.names.index(name)])

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


def direct_table(direct: Direct, further: Iterable[str] = ()) -> DirectTable:
    """Return direct variables as a table.

    A table that has these rows already is returned unchecked. Scalars become arrays: only then does
    numpy compute one situation and a thousand identically.

    Parameters
    ----------
    direct : mapping
        All DIRECT_VARIABLES by name, each a number or an array of shape (n,); others are ignored.
        Without vy it is 0.
    further : iterable of str
        Names of required variables besides.

    Raises
    ------
    ValueError
        A variable is missing.
    """
    names = (*DIRECT_VARIABLES, *further)
    if isinstance(direct, DirectTable) and direct.names == names:
        return direct
    direct = {"vy": 0.0, **direct}
    missing = [name for name in names if name not in direct]
    if missing:
        raise ValueError(
            f"direct variables: expected {', '.join(names)}; missing: {', '.join(missing)}"
        )
    given = np.broadcast_arrays(
        *(np.asarray(direct[name], dtype=float).reshape(-1) for name in names)
    )
    return DirectTable(names, np.stack(given))


NEAR = 0.04
"""Distance in m from the goal within which a robot at rest only turns to the goal's heading."""
NEAR_GOAL = 0.5
"""Distance in m from a goal within which its bearing does not decide how an action drives."""


@compiled
def wrapped(angle: float) -> float:
    """Return the same angle in [-pi, pi), in rad.

    The result is that of `ator_ros.geometry.wrap_angles`.
    """
    turned = angle + math.pi
    if not 0.0 <= turned < 2.0 * math.pi:  # usually it is, and the remainder is slow
        turned %= 2.0 * math.pi
    return turned - math.pi
