"""The search for the best orders of a chain's calls on a table of the costs of their legs.

Each call has a few candidates of its free variables (headings), so an order is a path through
layers of candidates. Two searches work on the same table:

- `best_orders` is exact: dynamic programming over sets of calls, last call, and candidate (Held and
  Karp 1962). It also returns the next best orders.
- `LocalSearch` improves an order of many calls by moving and reversing parts of it (Or-opt,
  2-opt), and leaves local optima by kicks (iterated local search). A changed part is evaluated
  exactly, with the best candidates of all its calls. Routing libraries have no such layers: with
  them each call would have one heading, or each candidate would be a stop of a generalized problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ator_ros.compiled import compiled
from ator_ros.geometry import BoolArray, FloatArray, IntArray
from ator_ros.tops.ordering import Ordering

_LONGEST_MOVED = 3  # calls of a part that is moved (Or-opt)
_NEAR = 10  # calls tried as successors of a call: those with the cheapest legs
MOST_TRIED = 1000
"""Moves that one call of `LocalSearch.improve` tries: a few ms for 100 calls."""
_WIDEST_KICK = 24  # calls of which a kick exchanges two parts


@dataclass(frozen=True, slots=True)
class LegOrder:
    """An order of the calls, the row of the candidate of each, in this order, and the cost."""

    order: tuple[int, ...]
    rows: tuple[int, ...]
    cost: float


# Exact


@dataclass(slots=True, eq=False)
class _Group:
    """One group of m calls in the dynamic program, with h candidates of each.

    Attributes
    ----------
    calls : ndarray, shape (m,)
        Indices of its calls.
    needed : ndarray, shape (m,)
        Bits of the calls that must come before each.
    possible : ndarray of bool, shape (2**m or 1, n + 1 or 1, m)
        See `ator_ros.tops.ordering.possible_steps`; all are possible if it has one element.
    entry : ndarray, shape (n + 1, h)
        Least cost from the start of the chain until the call before the group.
    forward, backward : ndarray, shape (2**m, m, h)
        Least costs from the start until the last of a set of calls, and from there to the end.
    """

    calls: IntArray
    needed: IntArray
    possible: BoolArray
    entry: FloatArray
    forward: FloatArray
    backward: FloatArray


def best_orders(
    costs: FloatArray,
    ordering: Ordering,
    possible: Sequence[BoolArray] | None,
    most: int,
    end: FloatArray | None = None,
) -> list[LegOrder]:
    """Return up to `most` orders, the best first; fewer if there are not so many.

    The first two are exactly the best ones. Each further one is the best that passes through a
    state (calls done, and last call) of none before it.

    Parameters
    ----------
    costs : ndarray, shape (n + 1, h, n, h)
        Cost of the leg from candidate h of call i - 1 (0: the start) to candidate h of call j;
        infinite where there is no such candidate.
    ordering : Ordering
        Groups and precedences of the n calls.
    possible : sequence of ndarray of bool, optional
        Possible steps, see `ator_ros.tops.ordering.possible_steps`; by default all.
    most : int
        Number of orders.
    end : ndarray, shape (n + 1, h), optional
        Cost of ending with candidate h of call i - 1; by default 0.
    """
    groups = _swept(costs, ordering, possible, end)
    marginals = [(group.forward + group.backward).min(axis=2) for group in groups]
    totals = np.concatenate([values.ravel() for values in marginals])
    firsts = np.cumsum([0, *(values.size for values in marginals)])
    passed = np.zeros(len(totals), dtype=bool)
    found: list[LegOrder] = []
    for state in np.argsort(totals, kind="stable"):
        if len(found) == most or not np.isfinite(totals[state]):
            break
        if passed[state]:
            continue
        number = int(np.searchsorted(firsts, state, side="right")) - 1
        done, last = divmod(int(state - firsts[number]), len(groups[number].calls))
        steps = _through(costs, groups, number, done, last)
        for group, bits, call, _ in steps:
            passed[firsts[group] + bits * len(groups[group].calls) + call] = True
        order = tuple(int(groups[group].calls[call]) for group, _, call, _ in steps)
        if all(order != other.order for other in found):
            rows = tuple(row for *_, row in steps)
            found.append(LegOrder(order, rows, float(totals[state])))
    return found


def _swept(
    costs: FloatArray,
    ordering: Ordering,
    possible: Sequence[BoolArray] | None,
    end: FloatArray | None,
) -> list[_Group]:
    """Return the groups with their least costs from the start and to the end."""
    groups = []
    entry = np.full(costs.shape[:2], np.inf)
    entry[0, 0] = 0.0
    anything = np.ones((1, 1, 1), dtype=bool)
    for number, calls in enumerate(ordering.groups):
        before = ordering.before[np.ix_(calls, calls)]
        count = len(calls)
        bits = 1 << np.arange(count)
        needed = (before * bits[:, None]).sum(axis=0)
        shape = (1 << count, count, costs.shape[1])
        group = _Group(
            np.array(calls),
            needed,
            anything if possible is None else possible[number],
            entry,
            np.empty(shape),
            np.empty(shape),
        )
        _sweep_forward(costs, group.calls, group.needed, group.possible, entry, group.forward)
        groups.append(group)
        entry = np.full_like(entry, np.inf)
        entry[group.calls + 1] = group.forward[-1]
    leave = np.zeros(costs.shape[:2]) if end is None else end
    for group in reversed(groups):
        group.backward[-1] = leave[group.calls + 1]
        leave = np.full_like(leave, np.inf)
        _sweep_backward(costs, group.calls, group.needed, group.possible, group.backward, leave)
    return groups


@compiled
def _may_follow(
    possible: BoolArray,
    needed: IntArray,
    done: int,
    last: int,
    number: int,
) -> bool:
    """Return whether a call of a group may come after `done` of them, and `last` (0: the start)."""
    if done >> number & 1 or needed[number] & ~done:
        return False
    return possible.size == 1 or possible[done, last, number]


@compiled
def _sweep_forward(
    costs: FloatArray,
    calls: IntArray,
    needed: IntArray,
    possible: BoolArray,
    entry: FloatArray,
    forward: FloatArray,
) -> None:
    """Fill the least costs from the start of the chain until each state of a group."""
    forward[:] = np.inf
    size = len(calls)
    for done in range((1 << size) - 1):
        for number in range(size):
            total = forward[done | 1 << number, number]
            for place in range(size if done else len(entry)):
                last = calls[place] + 1 if done else place
                sums = forward[done, place] if done else entry[place]
                if not _may_follow(possible, needed, done, last, number):
                    continue
                for row in range(len(sums)):
                    if sums[row] == np.inf:
                        continue
                    legs = costs[last, row, calls[number]]
                    for column in range(len(total)):
                        total[column] = min(total[column], sums[row] + legs[column])


@compiled
def _sweep_backward(
    costs: FloatArray,
    calls: IntArray,
    needed: IntArray,
    possible: BoolArray,
    backward: FloatArray,
    leave: FloatArray,
) -> None:
    """Fill the least costs from each state of a group to the end, and from before the group."""
    backward[:-1] = np.inf
    size = len(calls)
    for done in range((1 << size) - 2, -1, -1):
        for place in range(size if done else len(leave)):
            if done and not done >> place & 1:
                continue
            last = calls[place] + 1 if done else place
            total = backward[done, place] if done else leave[place]
            for number in range(size):
                if not _may_follow(possible, needed, done, last, number):
                    continue
                rest = backward[done | 1 << number, number]
                for row in range(len(total)):
                    legs = costs[last, row, calls[number]]
                    for column in range(len(rest)):
                        total[row] = min(total[row], legs[column] + rest[column])


_Step = tuple[int, int, int, int]
"""A step of an order: its group, the bits of the calls done with it, its number there, and row."""


def _through(
    costs: FloatArray,
    groups: Sequence[_Group],
    number: int,
    done: int,
    last: int,
) -> list[_Step]:
    """Return the steps of the best order that passes through a state of a group."""
    totals = groups[number].forward[done, last] + groups[number].backward[done, last]
    here: _Step = (number, done, last, int(totals.argmin()))
    steps = [here]
    while (previous := _previous(costs, groups, steps[0])) is not None:
        steps.insert(0, previous)
    while (following := _following(costs, groups, steps[-1])) is not None:
        steps.append(following)
    return steps


def _previous(costs: FloatArray, groups: Sequence[_Group], step: _Step) -> _Step | None:
    """Return the best step before another one; None before the first."""
    number, done, last, row = step
    group = groups[number]
    earlier = done & ~(1 << last)
    legs = costs[:, :, group.calls[last], row]
    if earlier:
        sums = group.forward[earlier] + legs[group.calls + 1]
        candidates = group.calls + 1
    else:
        sums = group.entry + legs
        candidates = np.arange(len(legs))
        if number == 0:
            return None
    if group.possible.size > 1:
        sums = np.where(group.possible[earlier, candidates, last][:, None], sums, np.inf)
    place, before = divmod(int(sums.argmin()), sums.shape[1])
    if earlier:
        return number, earlier, place, before
    former = groups[number - 1]
    own = int(np.flatnonzero(former.calls == place - 1)[0])
    return number - 1, (1 << len(former.calls)) - 1, own, before


def _following(costs: FloatArray, groups: Sequence[_Group], step: _Step) -> _Step | None:
    """Return the best step after another one; None after the last."""
    number, done, last, row = step
    origin = groups[number].calls[last] + 1
    if done == (1 << len(groups[number].calls)) - 1:
        number += 1
        done = 0
        if number == len(groups):
            return None
    group = groups[number]
    best: _Step | None = None
    least = np.inf
    for following in range(len(group.calls)):
        if not _may_follow(group.possible, group.needed, done, origin, following):
            continue
        after = done | 1 << following
        sums = costs[origin, row, group.calls[following]] + group.backward[after, following]
        if sums.min() < least:
            least = sums.min()
            best = (number, after, following, int(sums.argmin()))
    return best


# Local search


class SearchState(NamedTuple):
    """An order of n calls, its cost, and after which of them, shape (n + 1,), to try moves."""

    order: IntArray
    cost: float
    pending: BoolArray


class LocalSearch:
    """Improves the order of many calls.

    Attributes
    ----------
    order : ndarray, shape (n,)
        The best order found.
    cost : float
        Its cost, with the best candidates.

    Parameters
    ----------
    costs : ndarray, shape (n + 1, h, n, h)
        As for `best_orders`.
    ordering : Ordering
        Groups and precedences of the n calls.
    order : sequence of int
        The order to begin with.
    end : ndarray, shape (n + 1, h), optional
        As for `best_orders`.
    """

    def __init__(
        self,
        costs: FloatArray,
        ordering: Ordering,
        order: Sequence[int],
        end: FloatArray | None = None,
    ) -> None:
        self._costs = costs
        self._end = np.zeros(costs.shape[:2]) if end is None else end
        self._before = ordering.before
        self._has_precedences = bool(ordering.before.any())
        self._bounds = np.empty((len(order), 2), dtype=np.intp)  # first and last place of each call
        first = 0
        for group in ordering.groups:
            self._bounds[list(group)] = first, first + len(group) - 1
            first += len(group)
        legs = costs.min(axis=(1, 3))
        np.fill_diagonal(legs[1:], np.inf)
        self._near = np.argsort(legs, axis=1, kind="stable")[:, :_NEAR].copy()
        self._groups = [group for group in ordering.groups if len(group) > 2]
        self._rng = np.random.default_rng(len(order))  # the same request has the same answer
        self.order = np.array(order, dtype=np.intp)
        self.cost = self._cost(self.order)
        # calls (from 1; 0: the start) after which a move may improve the order ("don't-look bits")
        self._pending = np.ones(len(order) + 1, dtype=bool)
        self._since = 0  # moves tried since the last one that changed the order

    def _cost(self, order: IntArray) -> float:
        return float(_layers(self._costs, order, self._end)[1][0].min())

    def improve(self, cursor: int, most: int) -> int:
        """Try up to `MOST_TRIED` moves from a `cursor` on; make at most `most` of them.

        Returns the cursor of the next move to try, or -1 after the last one: then no move
        improves the order.
        """
        order, cost, cursor, self._since = _improved(
            self._costs, self._end, self._near, self._bounds, self._before, self.order,
            self._pending, cursor, self._since, most, self._has_precedences,
        )  # fmt: skip
        self.order = order
        self.cost = cost
        return int(cursor)

    def kick(self) -> None:
        """Exchange two neighboring parts of the order at random."""
        for _ in range(_NEAR):
            group = self._groups[self._rng.integers(len(self._groups))]
            first, last = self._bounds[group[0]]
            width = int(min(last - first + 1, _WIDEST_KICK))
            low = int(self._rng.integers(first, last - width + 2))
            cuts = self._rng.choice(width + 1, 3, replace=False)
            begin, middle, end = np.sort(cuts) + low
            first_part = self.order[begin:middle]
            second_part = self.order[middle:end]
            order = self.order.copy()
            order[begin:end] = np.concatenate((second_part, first_part))
            if not self._has_precedences or _keeps(order, self._before, begin, end - 1):
                self.order = order
                self.cost = self._cost(order)
                self._since = 0
                _touch(self._pending, order, begin, end - 1)
                return

    def state(self) -> SearchState:
        """Return the state of the search, to go back to it."""
        return SearchState(self.order, self.cost, self._pending.copy())

    def restore(self, state: SearchState) -> None:
        """Go back to a former state."""
        self.order = state.order
        self.cost = state.cost
        self._pending = state.pending.copy()
        self._since = 0

    def found(self) -> LegOrder:
        """Return the order with its best candidates."""
        _, backward = _layers(self._costs, self.order, self._end)
        rows = []
        origin, row = 0, 0
        for place, call in enumerate(self.order):
            row = int((self._costs[origin, row, call] + backward[place + 1]).argmin())
            rows.append(row)
            origin = call + 1
        return LegOrder(tuple(map(int, self.order)), tuple(rows), self.cost)


def nearest_next(costs: FloatArray, ordering: Ordering) -> list[int]:
    """Return the order in which each step has the cheapest leg from the best candidates before it.

    `costs` are as for `best_orders`.
    """
    order: list[int] = []
    sums = costs[0, 0]  # of each call and candidate after the present one
    for group in ordering.groups:
        left = np.array(group)
        while left.size:
            ready = left[~ordering.before[np.ix_(left, left)].any(axis=0)]
            call = int(ready[sums[ready].min(axis=1).argmin()])
            left = left[left != call]
            order.append(call)
            least = sums[call].min()
            arrived = sums[call] - least if np.isfinite(least) else sums[call]
            sums = (arrived[:, None, None] + costs[call + 1]).min(axis=0)
    return order


@compiled
def _layers(costs: FloatArray, order: IntArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least costs (n + 1, h) from the start until each place, and from it to the end.

    Row 0 is the start, which has one candidate.
    """
    count = len(order)
    width = costs.shape[1]
    forward = np.full((count + 1, width), np.inf)
    backward = np.zeros((count + 1, width))
    forward[0, 0] = 0.0
    backward[-1] = end[order[-1] + 1]
    for place in range(count):
        origin = order[place - 1] + 1 if place else 0
        _pass(costs, origin, order[place], forward[place], forward[place + 1])
    for place in range(count - 1, -1, -1):
        origin = order[place - 1] + 1 if place else 0
        for row in range(width):
            least = np.inf
            for column in range(width):
                total = costs[origin, row, order[place], column] + backward[place + 1, column]
                least = min(least, total)
            backward[place, row] = least
    backward[0, 1:] = np.inf
    return forward, backward


@compiled
def _pass(
    costs: FloatArray,
    origin: int,
    call: int,
    sums: FloatArray,
    after: FloatArray,
) -> None:
    """Fill the least costs until each candidate of a call, after those until its origin."""
    after[:] = np.inf
    for row in range(len(sums)):
        if sums[row] < np.inf:
            for column in range(len(after)):
                after[column] = min(after[column], sums[row] + costs[origin, row, call, column])


@compiled
def _keeps(order: IntArray, before: BoolArray, low: int, high: int) -> bool:
    """Return whether the places `low` to `high` of an order keep the precedences."""
    for place in range(low, high):
        for later in range(place + 1, high + 1):
            if before[order[later], order[place]]:
                return False
    return True


@compiled
def _in_bounds(order: IntArray, bounds: IntArray, low: int, high: int) -> bool:
    """Return whether the calls at the places `low` to `high` of an order belong to its groups."""
    for place in range(low, high + 1):
        if not bounds[order[place], 0] <= place <= bounds[order[place], 1]:
            return False
    return True


@compiled
def _improved(
    costs: FloatArray,
    end: FloatArray,
    near: IntArray,
    bounds: IntArray,
    before: BoolArray,
    order: IntArray,
    pending: BoolArray,
    cursor: int,
    since: int,
    most: int,
    has_precedences: bool,
) -> tuple[IntArray, float, int, int]:
    """Return an improved order, its cost, and the cursor of the next move; see `LocalSearch`.

    A move makes a call, of a few near ones, follow another call or the start that is `pending`.
    `since` moves were tried since the last one that changed the order; their new number is the last
    item.
    """
    order = order.copy()
    trial = order.copy()
    sums = np.empty((2, costs.shape[1]))
    forward, backward = _layers(costs, order, end)
    cost = backward[0, 0]
    kinds = 3 * _LONGEST_MOVED + 1
    of_one = near.shape[1] * kinds  # moves of one call
    moves = len(near) * of_one
    made = 0
    tried = 0
    while pending.any():
        if made == most or tried == MOST_TRIED:
            return order, cost, cursor, since
        origin, move = divmod(cursor, of_one)
        if not pending[origin]:
            cursor = (origin + 1) * of_one % moves
            since = 0
            continue
        choice, kind = divmod(move, kinds)
        cursor = (cursor + 1) % moves
        since += 1
        tried += 1
        low, high = _moved(order, trial, origin - 1, near[origin, choice], kind)
        good = (
            low < high
            and _in_bounds(trial, bounds, low, high)
            and not (has_precedences and not _keeps(trial, before, low, high))
        )
        if good:
            total = _total(costs, end, trial, low, high, forward, backward, sums)
            if cost - total > 1e-9 * abs(total):
                order[low : high + 1] = trial[low : high + 1]
                forward, backward = _layers(costs, order, end)
                cost = backward[0, 0]
                _touch(pending, order, low, high)
                since = 0
                made += 1
        if low < high:
            trial[low : high + 1] = order[low : high + 1]
        if move + 1 == of_one and since >= of_one:
            pending[origin] = False
    return order, cost, -1, 0


@compiled
def _touch(pending: BoolArray, order: IntArray, low: int, high: int) -> None:
    """Note that the places `low` to `high` of an order have changed, and their neighbors' legs."""
    if low == 0:
        pending[0] = True
    for place in range(max(low - 1, 0), min(high + 2, len(order))):
        pending[order[place] + 1] = True


@compiled
def _moved(
    order: IntArray,
    trial: IntArray,
    first: int,
    second: int,
    kind: int,
) -> tuple[int, int]:
    """Write an order in which call `second` follows call `first` (-1: the start) into `trial`.

    Returns the first and the last place that differ; equal if there is no such move.
    """
    count = len(order)
    at = -1
    to = -1
    for place in range(count):
        if order[place] == first:
            at = place
        if order[place] == second:
            to = place
    if to == at + 1 or to == at:
        return 0, 0
    if kind == 3 * _LONGEST_MOVED:  # 2-opt: reverse what lies between
        if to < at:
            return 0, 0
        for place in range(at + 1, to + 1):
            trial[place] = order[to + at + 1 - place]
        return at + 1, to
    length = kind % _LONGEST_MOVED + 1
    how = kind // _LONGEST_MOVED
    # The part from `begin` to `end` comes directly after place `target`.
    begin = to
    end = to + length - 1
    target = at
    if how == 1:  # the part that ends with the second call, reversed
        begin = to - length + 1
        end = to
    elif how == 2:  # the part that ends with the first call, before the second one
        begin = at - length + 1
        end = at
        target = to - 1
    if begin < 0 or end >= count or begin <= target + 1 <= end + 1:
        return 0, 0
    low = min(begin, target + 1)
    high = max(end, target)
    write = low
    if target < begin:
        write = _written(order, trial, begin, end, how == 1, write)
        _written(order, trial, target + 1, begin - 1, False, write)
    else:
        write = _written(order, trial, end + 1, target, False, write)
        _written(order, trial, begin, end, how == 1, write)
    return low, high


@compiled
def _written(
    order: IntArray,
    trial: IntArray,
    begin: int,
    end: int,
    backward: bool,
    write: int,
) -> int:
    """Write the places `begin` to `end` of an order from place `write` on; return the next one."""
    for place in range(end - begin + 1):
        trial[write + place] = order[end - place if backward else begin + place]
    return write + end - begin + 1


@compiled
def _total(
    costs: FloatArray,
    end: FloatArray,
    order: IntArray,
    low: int,
    high: int,
    forward: FloatArray,
    backward: FloatArray,
    sums: FloatArray,
) -> float:
    """Return the cost of an order that differs from that of the layers at `low` to `high`."""
    sums[low % 2] = forward[low]
    for place in range(low, high + 1):
        origin = order[place - 1] + 1 if place else 0
        _pass(costs, origin, order[place], sums[place % 2], sums[(place + 1) % 2])
    arrived = sums[(high + 1) % 2]
    if high + 1 == len(order):
        return float((arrived + end[order[-1] + 1]).min())
    _pass(costs, order[high] + 1, order[high + 1], arrived, sums[high % 2])
    return float((sums[high % 2] + backward[high + 2]).min())
