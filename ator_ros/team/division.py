"""The division of a round among robots: which robot executes which steps, and in which order.

Each robot has a table of the times that it needs from step to step. The division is exact up to
`MOST_EXACT` steps, for any number of robots: the best order of every set of steps by dynamic
programming (Held and Karp 1962), then the best division of the sets. Beyond, steps are removed and
inserted again where they cost least, many times (ruin and recreate, Schrimpf et al. 2000).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.tops.ordering import Ordering

MOST_EXACT = 10
"""Steps up to which the best division is found."""
_ROUNDS = 400  # removals of steps: more of them hardly shorten rounds of 30 steps
_REMOVED = 0.4  # greatest share of the steps that are removed at once
_SAME = 1e-9  # share by which sums of the same times may differ
_NOTHING = 0  # the empty set of steps, as bits
_NONE_FOUND = "expected a division that keeps the precedences, got none"


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

    @classmethod
    def of(
        cls,
        orders: Sequence[Sequence[int]],
        tables: Sequence[FloatArray],
    ) -> Division:
        """Return the division with its times, by the tables of the robots."""
        times = [_time(order, table) for order, table in zip(orders, tables, strict=True)]
        return cls(tuple(map(tuple, orders)), tuple(times))


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


def divide(
    tables: Sequence[FloatArray],
    steps: Steps,
    *,
    total: bool = False,
) -> Division:
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


def _exact(
    tables: Sequence[FloatArray],
    steps: Steps,
    *,
    total: bool,
) -> Division:
    swept = [_times_of_sets(table, steps) for table in tables]
    times = np.stack([sweep.min(axis=1) for sweep in swept])
    times[:, _NOTHING] = 0.0
    if not total:
        earliest = _best_split(times, np.maximum).cost
        times[times > earliest * (1.0 + _SAME)] = np.inf
    split = _best_split(times, np.add)
    if not math.isfinite(split.cost):
        raise DivisionError(_NONE_FOUND)
    orders = []
    for part, own_times, table in zip(split.parts, swept, tables, strict=True):
        orders.append(_order_of(part, own_times, table))
    return Division.of(orders, tables)


def _times_of_sets(
    table: FloatArray,
    steps: Steps,
) -> FloatArray:
    """Return the least time of each set of steps (as bits) by its last step, shape (2**m, m)."""
    count = table.shape[1]
    numbers = np.arange(count)
    bits = 1 << numbers
    needed = (steps.before * bits[:, None]).sum(axis=0)
    later = (steps.after * bits[None, :]).sum(axis=1)
    times = np.full((1 << count, count), np.inf)
    may_be_first = needed == 0
    times[bits, numbers] = np.where(may_be_first, table[0], np.inf)
    for done in range(1, 1 << count):
        is_new = done & bits == 0
        is_ready = needed & ~done == 0
        is_in_time = later & done == 0
        arrivals = times[done][:, None] + table[1:]
        for step in np.flatnonzero(is_new & is_ready & is_in_time):
            times[done | bits[step], step] = arrivals[:, step].min()
    return times


class _Split(NamedTuple):
    """The best division of all steps: its cost, and the set of steps of each robot as bits."""

    cost: float
    parts: tuple[int, ...]


def _best_split(
    times: FloatArray,
    combined: np.ufunc,
) -> _Split:
    """Return the division with the least combined time.

    `times` are those of each robot and set of steps, shape (r, 2**m).
    """
    sets = np.arange(times.shape[1])
    best = np.where(sets == _NOTHING, 0.0, np.inf)  # of each set, divided among the robots so far
    choices = []
    for own_times in times:
        least = np.full(len(sets), np.inf)
        choice = np.full(len(sets), _NOTHING)
        for part in np.flatnonzero(np.isfinite(own_times)):
            supersets = sets[sets & part == part]
            rest = supersets ^ part
            costs = combined(best[rest], own_times[part])
            is_better = costs < least[supersets]
            improved = supersets[is_better]
            least[improved] = costs[is_better]
            choice[improved] = part
        best = least
        choices.append(choice)
    left = len(sets) - 1
    parts: list[int] = []
    for choice in reversed(choices):
        own_part = int(choice[left])
        parts.insert(0, own_part)
        left ^= own_part
    return _Split(float(best[-1]), tuple(parts))


def _order_of(
    part: int,
    times: FloatArray,
    table: FloatArray,
) -> list[int]:
    """Return the best order of a set of steps, from its end."""
    order: list[int] = []
    while part:
        sums = times[part]
        if order:
            sums = sums + table[1:, order[0]]
        last = int(sums.argmin())
        order.insert(0, last)
        part ^= 1 << last
    return order


# Many steps


def _improved(
    tables: Sequence[FloatArray],
    steps: Steps,
    *,
    total: bool,
) -> Division:
    """Return the best of many divisions, each made by removing and inserting steps."""
    rng = np.random.default_rng(len(steps.before))  # the same request has the same answer
    blocks = _blocks(steps)
    most = max(1, round(_REMOVED * len(blocks)))
    orders: list[list[int]] = [[] for _ in tables]
    orders = _inserted(tables, steps, orders, blocks, total=total)
    cost = _cost(Division.of(orders, tables).times, total=total)
    for _ in range(_ROUNDS):
        shuffled = rng.permutation(len(blocks))
        count = rng.integers(1, most + 1)
        removed = [blocks[number] for number in shuffled[:count]]
        kept = [_without(order, removed) for order in orders]
        tried = _inserted(tables, steps, kept, removed, total=total)
        cost_of_tried = _cost(Division.of(tried, tables).times, total=total)
        if cost_of_tried <= cost:
            orders = tried
            cost = cost_of_tried
    if not all(map(math.isfinite, cost)):
        raise DivisionError(_NONE_FOUND)
    return Division.of(orders, tables)


def _blocks(steps: Steps) -> list[list[int]]:
    """Return the steps that one robot must execute together, each after those that it needs."""
    count, block_of = connected_components(steps.before, directed=False)
    needed = steps.before.sum(axis=0)
    blocks = []
    for number in range(count):
        block = np.flatnonzero(block_of == number)
        ordered = np.argsort(needed[block], kind="stable")
        blocks.append(block[ordered].tolist())
    return blocks


def _without(
    order: Sequence[int],
    removed: Sequence[Sequence[int]],
) -> list[int]:
    gone = set(itertools.chain.from_iterable(removed))
    return [step for step in order if step not in gone]


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
    times = [_time(order, table) for order, table in zip(found, tables, strict=True)]
    for block in blocks:
        options = []
        for robot, table in enumerate(tables):
            order = found[robot]
            for step in block:
                order = _with_step(table, steps, order, step)
            own = [*times[:robot], _time(order, table), *times[robot + 1 :]]
            options.append((_cost(own, total=total), robot, order, own))
        _, best, best_order, times = min(options, key=lambda option: option[0])
        found[best] = best_order
    return found


def _with_step(
    table: FloatArray,
    steps: Steps,
    order: list[int],
    step: int,
) -> list[int]:
    """Return the order with a step at the place where it costs least; there always is one."""
    places = np.array(order, dtype=np.intp)
    origins = np.append(0, places + 1)
    costs = table[origins, step]
    with np.errstate(invalid="ignore"):  # inf - inf where legs are impossible
        costs[:-1] += table[step + 1, places]
        costs[:-1] -= table[origins[:-1], places]
    must_follow = np.flatnonzero(steps.after[places, step])
    must_precede = np.flatnonzero(steps.after[step, places])
    first = int(must_follow[-1]) + 1 if len(must_follow) else 0
    last = int(must_precede[0]) if len(must_precede) else len(order)
    allowed = costs[first : last + 1]
    known = np.where(np.isnan(allowed), np.inf, allowed)  # where a leg is impossible
    place = first + int(known.argmin())
    return [*order[:place], step, *order[place:]]


def _time(
    order: Sequence[int],
    table: FloatArray,
) -> float:
    """Return the time in s that a robot needs for an order."""
    origins = [0, *(step + 1 for step in order)][:-1]
    return float(table[origins, list(order)].sum())


def _cost(
    times: Sequence[float],
    *,
    total: bool,
) -> tuple[float, float]:
    """Return what is minimized, first and second."""
    whole = math.fsum(times)
    last = max(times)
    return (whole, last) if total else (last, whole)
