"""The assignment of roles to robots, and the rule by which a robot keeps its role.

Robots are listed in the order of their names, on all robots of a team alike, and roles in the order
of their importance. Where sums of costs are equal, the first robot gets the more important role.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.refinement.gate import Gate

_TIE = 1e-9  # s; below all differences that matter


@dataclass(frozen=True, slots=True)
class Assignment:
    """An assignment of roles.

    Attributes
    ----------
    roles : tuple of int or None
        The role of each robot.
    gain : float
        By how much the cheapest assignment is expected to be below this one, in s.
    uncertainty : float
        Of the gain, in s.
    """

    roles: tuple[int | None, ...]
    gain: float = 0.0
    uncertainty: float = 0.0


def assign(
    costs: FloatArray,
    errors: FloatArray,
    held: Sequence[int | None],
    gate: Gate,
    may_change: Sequence[bool] | None = None,
) -> Assignment:
    """Assign m roles to n robots so that the sum of the costs is least.

    If robots are too few, the last roles are left out, and so are roles that no robot can take.
    Robots keep their roles unless the gain of a change is expected to pay, by the comparison of
    `gate`. Changes that do not depend on each other are compared one by one.

    Errors of the costs count as independent. Those of robots of different make are, as their models
    come from different drives. Robots with the same models, and one robot in two roles, err alike
    in similar situations: the gain is then less uncertain than assumed, and a role is kept longer.

    Parameters
    ----------
    costs, errors : ndarray, shape (n, m)
        What each role costs each robot, and what this may be wrong by (root mean square), in s. The
        cost is infinite or NaN if the robot cannot take the role.
    held : sequence of int or None
        The present role of each robot. Of several robots with one role, the one with the least cost
        keeps it.
    gate : Gate
        Compares the gain of a change with its uncertainty.
    may_change : sequence of bool, optional
        Whether the role of each robot may change because it pays; None: all.
    """
    may = np.ones(len(costs), dtype=bool) if may_change is None else np.array(may_change)
    costs = np.where(np.isfinite(costs), costs, np.inf)
    filled = _filled(np.isfinite(costs))
    costs[:, ~filled] = np.inf
    cheapest = _cheapest(costs, filled)
    chosen = cheapest
    if cheapest is not None:
        kept = _cheapest(_with_held(costs, held), filled)
        if kept is not None:
            chosen = _changed_where_it_pays(costs, errors, kept, cheapest, gate, may)
    if chosen is None or cheapest is None:
        return Assignment((None,) * len(costs))
    roles = tuple(int(row.argmax()) if row.any() else None for row in chosen)
    return Assignment(roles, *_gain(costs, errors, chosen, cheapest))


def waiting(
    roles: Sequence[int | None],
    places: Sequence[tuple[float, float]],
    reaches: Sequence[float],
) -> tuple[bool, ...]:
    """Return whether each robot must wait, as a robot with a more important role needs its place.

    `places` are where the robots would end (m); they must be as far apart as the `reaches` of both
    robots together (m).
    """
    sent: list[int] = []
    found = [False] * len(roles)
    numbered = ((role, robot) for robot, role in enumerate(roles) if role is not None)
    for _, robot in sorted(numbered):
        found[robot] = any(
            math.dist(places[robot], places[other]) < reaches[robot] + reaches[other]
            for other in sent
        )
        if not found[robot]:
            sent.append(robot)
    return tuple(found)


def _filled(able: BoolArray) -> BoolArray:
    """Return which roles are filled, shape (m,): each as far as the more important ones allow."""
    filled = np.zeros(able.shape[1], dtype=bool)
    for role in range(able.shape[1]):
        filled[role] = True
        matched = maximum_bipartite_matching(csr_matrix(able[:, filled]), perm_type="row")
        filled[role] = bool(np.all(matched >= 0))
    return filled


def _cheapest(
    costs: FloatArray,
    filled: BoolArray,
) -> BoolArray | None:
    """Return the pairs of the cheapest assignment of the filled roles; None if there is none."""
    pairs = np.zeros(costs.shape, dtype=bool)
    columns = np.flatnonzero(filled)
    later = np.outer(np.arange(len(costs)), np.arange(costs.shape[1], 0, -1))
    in_order = costs + _TIE * later
    try:
        robots, roles = linear_sum_assignment(in_order[:, columns])
    except ValueError:  # scipy's sign that some role has no robot
        return None
    pairs[robots, columns[roles]] = True
    return pairs


def _with_held(
    costs: FloatArray,
    held: Sequence[int | None],
) -> FloatArray:
    """Return the costs with infinite ones for all that would change a role that is held."""
    found = costs.copy()
    taken: set[int] = set()
    claims = [
        (costs[robot, role], robot, role) for robot, role in enumerate(held) if role is not None
    ]
    for cost, robot, role in sorted(claims):
        if role in taken or not np.isfinite(cost):
            continue
        taken.add(role)
        found[robot] = np.inf
        found[:, role] = np.inf
        found[robot, role] = costs[robot, role]
    return found


def _changed_where_it_pays(
    costs: FloatArray,
    errors: FloatArray,
    kept: BoolArray,
    cheapest: BoolArray,
    gate: Gate,
    may_change: BoolArray,
) -> BoolArray:
    """Return `kept` with those parts of `cheapest` whose gain is expected to pay."""
    robots, roles = kept.shape
    links = np.zeros((robots + roles, robots + roles), dtype=bool)
    links[:robots, robots:] = kept ^ cheapest
    count, part_of = connected_components(csr_matrix(links), directed=False)
    chosen = kept.copy()
    for part in range(count):
        inside = (part_of[:robots] == part)[:, None] & (part_of[robots:] == part)[None, :]
        before = kept & inside
        after = cheapest & inside
        may = may_change[part_of[:robots] == part].all()
        if may and gate.pays(*_gain(costs, errors, before, after)):
            chosen[inside] = cheapest[inside]
    return chosen


def _gain(
    costs: FloatArray,
    errors: FloatArray,
    before: BoolArray,
    after: BoolArray,
) -> tuple[float, float]:
    """Return by how much the pairs of `after` cost less, and the uncertainty of that, in s."""
    gain = float(costs[before].sum() - costs[after].sum())
    different = errors[before ^ after]
    return gain, math.sqrt(float(np.square(different).sum()))
