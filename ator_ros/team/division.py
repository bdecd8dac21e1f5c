"""The division of a round among robots: who executes which steps, and in which order.

Each robot has a table of the times that it needs from step to step. The division is exact up to
`MOST_EXACT` steps, for any number of robots: the best order of every set of steps by dynamic
programming (Held and Karp 1962), then the best division of the sets. Beyond, steps are removed and
inserted again where they cost least, many times (ruin and recreate, Schrimpf et al. 2000).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from ator_ros.geometry import BoolArray, FloatArray, IntArray
from ator_ros.tops.ordering import Ordering

MOST_EXACT = 10
"""Steps up to which the best division is found."""
_ROUNDS = 400  # removals of steps: more of them hardly shorten rounds of 30 steps
_REMOVED = 0.4  # greatest share of the steps that are removed at once
_SAME = 1e-9  # share by which sums of the same times may differ


class DivisionError(ValueError):
    """No robot can execute a step, or no division keeps the precedences."""


@dataclass(frozen=True, slots=True)
class Division:
    """A division of the steps.

    Attributes
    ----------
    orders : tuple of tuple of int
        For each robot its steps in their order.
    times : tuple of float
        For each robot the time in s that it needs.
    """

    orders: tuple[tuple[int, ...], ...]
    times: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """What restricts the division of m steps.

    Attributes
    ----------
    before, after : ndarray of bool, shape (m, m)
        Element [i, j] of `before`: a robot that executes step j must have executed step i before.
        Of `after`: a robot that executes both executes step j after step i.
    """

    before: BoolArray
    after: BoolArray

    @classmethod
    def of(cls, ordering: Ordering) -> Steps:
        """Return the restrictions of a chain.

        Within each robot's chain the groups keep their order, and so do calls with a precedence,
        which one robot executes together.
        """
        group_of = np.zeros(len(ordering.before), dtype=int)
        for number, group in enumerate(ordering.groups):
            group_of[list(group)] = number
        earlier_group = group_of[:, None] < group_of[None, :]
        return cls(ordering.before, earlier_group | ordering.before)


def divide(tables: Sequence[FloatArray], steps: Steps, *, total: bool = False) -> Division:
    """Divide m steps among robots so that the last of them ends as early as possible.

    Of the divisions in which it does, the one with the least sum of times is taken.

    Parameters
    ----------
    tables : sequence of ndarray, shapes (m + 1, m)
        For each robot the time in s from its start (row 0), or from the end of step i - 1, to the
        end of step j; NaN or infinite where it cannot do that.
    steps : Steps
        The precedences.
    total : bool
        Minimize the sum of the times instead.

    Raises
    ------
    DivisionError
        There is no division.
    """
    known = [np.where(np.isfinite(table), table, np.inf) for table in tables]
    for step in range(len(steps.before)):
        if not any(np.isfinite(table[:, step]).any() for table in known):
            raise DivisionError(f"step {step + 1}: expected a robot that can execute it, got none")
    if len(steps.before) <= MOST_EXACT:
        return _exact(known, steps, total=total)
    return _improved(known, steps, total=total)


# Exact


def _exact(tables: Sequence[FloatArray], steps: Steps, *, total: bool) -> Division:
    swept = [_times_of_sets(table, steps) for table in tables]
    times = np.array([sweep.min(axis=1) for sweep in swept])
    times[:, 0] = 0.0
    if not total:
        last = _best_split(times, np.maximum)[0][-1]
        times = np.where(times <= last * (1.0 + _SAME), times, np.inf)
    sums, choices = _best_split(times, np.add)
    if not math.isfinite(sums[-1]):
        raise DivisionError("expected a division that keeps the precedences, got none")
    left = len(sums) - 1
    sets: list[int] = []
    for choice in reversed(choices):
        sets.insert(0, int(choice[left]))
        left ^= sets[0]
    orders = [_order_of(own, *pair) for own, *pair in zip(sets, swept, tables, strict=True)]
    return Division(
        tuple(orders), tuple(float(own[done]) for own, done in zip(times, sets, strict=True))
    )


def _times_of_sets(table: FloatArray, steps: Steps) -> FloatArray:
    """Return the least time of each set of steps (as bits) by its last step, shape (2**m, m)."""
    count = table.shape[1]
    bits = 1 << np.arange(count)
    needed = (steps.before * bits[:, None]).sum(axis=0)
    later = (steps.after.T * bits[:, None]).sum(axis=0)
    times = np.full((1 << count, count), np.inf)
    times[bits, np.arange(count)] = np.where(needed == 0, table[0], np.inf)
    for done in range(1, 1 << count):
        arrived = (times[done, :, None] + table[1:]).min(axis=0)
        may_follow = (done & bits == 0) & (needed & ~done == 0) & (later & done == 0)
        for step in np.flatnonzero(may_follow).tolist():
            times[done | 1 << step, step] = arrived[step]
    return times


def _best_split(times: FloatArray, combined: np.ufunc) -> tuple[FloatArray, list[IntArray]]:
    """Return the least combined time of each set, and for each robot the part that it executes.

    `times` are those of each robot and set, shape (r, 2**m). The first robots divide the rest.
    """
    every = np.arange(times.shape[1])
    best = np.where(every == 0, 0.0, np.inf)
    choices = []
    for own in times:
        least = np.full(len(every), np.inf)
        choice = np.zeros(len(every), dtype=np.intp)
        for part in every:
            if not np.isfinite(own[part]):
                continue
            whole = every[every & part == part]
            sums = combined(best[whole ^ part], own[part])
            better = sums < least[whole]
            least[whole[better]] = sums[better]
            choice[whole[better]] = part
        best = least
        choices.append(choice)
    return best, choices


def _order_of(done: int, times: FloatArray, table: FloatArray) -> tuple[int, ...]:
    """Return the best order of a set of steps."""
    order: list[int] = []
    while done:
        sums = times[done] if not order else times[done] + table[1:, order[0]]
        order.insert(0, int(sums.argmin()))
        done ^= 1 << order[0]
    return tuple(order)


# Many steps


def _improved(tables: Sequence[FloatArray], steps: Steps, *, total: bool) -> Division:
    """Return the best of many divisions, each made by removing and inserting steps."""
    rng = np.random.default_rng(len(steps.before))  # the same request has the same answer
    blocks = _blocks(steps)
    orders = _inserted(tables, steps, [[] for _ in tables], blocks, total=total)
    cost = _cost(tables, orders, total=total)
    most = max(1, round(_REMOVED * len(blocks)))
    for _ in range(_ROUNDS):
        chosen = rng.permutation(len(blocks))[: rng.integers(1, most + 1)]
        removed = [blocks[number] for number in chosen]
        gone = {step for block in removed for step in block}
        kept = [[step for step in order if step not in gone] for order in orders]
        tried = _inserted(tables, steps, kept, removed, total=total)
        found = _cost(tables, tried, total=total)
        if found <= cost:
            orders = tried
            cost = found
    times = [_time(table, order) for table, order in zip(tables, orders, strict=True)]
    if not all(map(math.isfinite, times)):
        raise DivisionError("expected a division that keeps the precedences, found none")
    return Division(tuple(map(tuple, orders)), tuple(times))


def _blocks(steps: Steps) -> list[list[int]]:
    """Return the steps that one robot must execute together, each after those that it needs."""
    count, numbers = connected_components(steps.before, directed=False)
    blocks = [np.flatnonzero(numbers == number) for number in range(count)]
    depth = steps.before.sum(axis=0)
    return [block[np.argsort(depth[block], kind="stable")].tolist() for block in blocks]


def _inserted(
    tables: Sequence[FloatArray],
    steps: Steps,
    orders: Sequence[Sequence[int]],
    blocks: Sequence[Sequence[int]],
    *,
    total: bool,
) -> list[list[int]]:
    """Return the orders with each block inserted, one after the other, where it costs least."""
    found = [list(order) for order in orders]
    for block in blocks:
        options = []
        for robot, table in enumerate(tables):
            tried = list(found)
            for step in block:
                tried[robot] = _with_step(table, steps, tried[robot], step)
            options.append(tried)
        found = min(options, key=lambda tried: _cost(tables, tried, total=total))
    return found


def _with_step(table: FloatArray, steps: Steps, order: list[int], step: int) -> list[int]:
    """Return the order with a step at the place where it costs least; there always is one."""
    places = np.array(order, dtype=np.intp)
    origins = np.append(0, places + 1)
    costs = table[origins, step]
    costs[:-1] += table[step + 1, places] - table[origins[:-1], places]
    must_follow = np.flatnonzero(steps.after[places, step])
    must_precede = np.flatnonzero(steps.after[step, places])
    first = int(must_follow[-1]) + 1 if len(must_follow) else 0
    last = int(must_precede[0]) if len(must_precede) else len(order)
    place = first + int(np.nan_to_num(costs[first : last + 1], nan=np.inf).argmin())
    return [*order[:place], step, *order[place:]]


def _time(table: FloatArray, order: Sequence[int]) -> float:
    """Return the time in s of an order."""
    origins = [0, *(step + 1 for step in order[:-1])]
    return float(table[origins[: len(order)], list(order)].sum())


def _cost(
    tables: Sequence[FloatArray], orders: Sequence[Sequence[int]], *, total: bool
) -> tuple[float, float]:
    """Return what is minimized, first and second."""
    times = [_time(table, order) for table, order in zip(tables, orders, strict=True)]
    return (math.fsum(times), max(times)) if total else (max(times), math.fsum(times))
