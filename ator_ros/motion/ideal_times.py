"""How long ideal motions between two poses take: derived variables that grow with the work of an action.

They come from the direct variables and the robot's description alone, and know nothing of an action's state
or plan. But they are motions of the shape that our own actions drive best (turn while gaining speed, drive
straight, turn while losing speed, run straight to the goal), so much of what there is to learn is known to
them before. docs/ablation.md tells the accuracy with and without them, the evaluation what they would choose.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ator_ros.compiled import in_shares
from ator_ros.geometry import FloatArray
from ator_ros.motion.families import Family
from ator_ros.motion.motion_search import search_fastest

_SHARE = 60
"""Situations that one core takes at least: some 60 microseconds."""


@dataclass(frozen=True)
class Motions:
    """The fastest motion of a family in each situation: arrays of shape (n,).

    Attributes
    ----------
    time : ndarray
        In s.
    turn : ndarray
        Sum of the angles of both turns in rad.
    """

    time: FloatArray
    turn: FloatArray

    def after(self, time: FloatArray) -> Motions:
        """Return the motions with `time` (s) before them."""
        return Motions(self.time + time, self.turn)


def fastest_motions(ends: FloatArray, family: Family, *, hold: float) -> Motions:
    """Return the fastest motion of `family` in each of n situations to one of m destinations.

    Parameters
    ----------
    ends : ndarray, shape (5, m, n)
        Both ends, in the frame of the start: destination x, y of the axle in m and heading there in rad,
        forward speeds at the start and at the destination in m/s. Whichever destination is reached first
        counts.
    family : Family
        Which motions there are.
    hold : float
        Distance in m from the destination to the object in front of it.
    """
    time, turn = result = np.empty((2, ends.shape[2]))
    search = partial(
        search_fastest, ends, family.rows, family.tables, family.rules(hold), family.missed, result
    )
    in_shares(search, ends.shape[2], _SHARE)
    return Motions(time, turn)
