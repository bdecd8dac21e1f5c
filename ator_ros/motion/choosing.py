"""The kinds of ideal motions that a robot needs, chosen from all combinations of a fine grid.

They are chosen one by one: the next one is that which brings the times nearest to those of the whole grid, as
shares of these, in motions that are drawn. The choice ends where the rest of the grid would hardly bring them
nearer, or at `MOST` kinds. Most robots need as many while they hold an object; other motions then take up to
0.8 % longer than with the whole grid (docs/motion_families.json).
"""

from __future__ import annotations

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.motion.families import Family
from ator_ros.motion.motion_search import search_fastest
from ator_ros.robot.description import Limits

NEAR = 0.0005
"""The choice ends where the rest of the grid would save less than this share of the time, in the mean."""
MOST = 120
"""Kinds that are chosen at most: the time that a search takes grows with them."""
_MOTIONS, _SEED = 2000, 5
_LATE = 3.0  # how many times the least time counts where no chosen kind leads to the destination


def needed_kinds(grid: Family, *, hold: float) -> list[int]:
    """Return the numbers of those kinds of a family that are needed, the most useful first.

    It takes a second for a thousand kinds; the search has to be compiled (`ator_ros.compiled`).

    Parameters
    ----------
    grid : Family
        With all kinds to choose from.
    hold : float
        Distance in m from the destination to the object in front of it.
    """
    times = times_of(grid, drawn_ends(grid.limits, _MOTIONS, np.random.default_rng(_SEED)), hold)
    return chosen(times, MOST, near=NEAR) or [0]  # of a grid that leads nowhere


def drawn_ends(limits: Limits, count: int, rng: np.random.Generator) -> FloatArray:
    """Return ends of motions, (5, 1, count), as `search_fastest` takes them.

    They are up to 5 m apart, half of them nearer than the others. Half begin, and half end, at rest.
    """
    x, y, turn = (rng.uniform(-most, most, count) for most in (4.0, 3.0, np.pi))
    nearer = np.where(rng.random(count) < 0.5, rng.random(count), 1.0)
    speeds = limits.v * rng.random((2, count)) * rng.integers(0, 2, (2, count))
    return np.stack((nearer * x, nearer * y, turn, *speeds))[:, None]


def times_of(family: Family, ends: FloatArray, hold: float) -> FloatArray:
    """Return the time in s of each kind in each situation, (kinds, n); infinite where it leads elsewhere."""
    times = np.empty((len(family.kinds), ends.shape[2]))
    for kind in range(len(family.kinds)):
        result = np.empty((2, ends.shape[2]))
        row = family.rows[kind : kind + 1]
        search_fastest(ends, row, family.tables, family.rules(hold), (np.inf, 0.0), result, 0, ends.shape[2])
        times[kind] = result[0]
    return times


def chosen(times: FloatArray, most: int, *, near: float = 0.0) -> list[int]:
    """Choose up to `most` kinds by the times of each, (kinds, n): the one that saves the most is next.

    The choice ends early where times are longer than those of all kinds by a share of `near` or less, in the
    mean.
    """
    least = times.min(axis=0)
    reached = np.isfinite(least)
    ratios = times[:, reached] / least[reached]
    so_far, picked = np.full(ratios.shape[1], _LATE), list[int]()
    while len(picked) < most and so_far.sum() > (1.0 + near) * len(so_far):
        picked.append(int(np.argmin(np.minimum(so_far, ratios).sum(axis=1))))
        so_far = np.minimum(so_far, ratios[picked[-1]])
    return picked
