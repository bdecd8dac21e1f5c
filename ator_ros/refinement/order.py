"""The order of a chain's calls: one table of predicted costs, and the orders that promise most.

The table has the cost of each leg from call to call, for a grid of candidates of their free
variables. `ator_ros.refinement.order_search` finds the best orders on it, up to `MOST_EXACT` calls
of a group exactly. The refiner then searches the variables of the best few without a grid.

A table with a coarse grid comes first. It has an order long before the fine one is complete. The
first table of many calls has their given values only; further ones predict only legs that are cheap
on it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.goal_variables import STOP, goal_values, with_values
from ator_ros.bases.description import Robot
from ator_ros.bases.routes import arrival_heading
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.refinement.chain_prediction import (
    PredictsPerformance,
    StepModel,
    leg_rows,
    values_of,
)
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.order_search import (
    MOST_TRIED,
    LegOrder,
    LocalSearch,
    best_orders,
    nearest_next,
)
from ator_ros.refinement.search import Allowed, Deadline, Pairs, Work, first_candidates
from ator_ros.refinement.stops import (
    costs_of_end,
    may_pass,
    passing_rows,
    reached,
    table_names,
    while_stopping,
    with_passing,
)
from ator_ros.tops.chain import TopChain
from ator_ros.tops.ordering import Ordering, depends_on_order, possible_steps
from ator_ros.tops.ranges import Range
from ator_ros.world.state import World

MOST_EXACT = 10
"""Calls of a group up to which the best order on the table is found exactly."""
_COARSE = (1, 4, 6, 8)  # candidates by the number of a call's free variables
_FINE = (1, 12, 18, 24)
_MANY = 40  # calls from which on tables of all legs would take too long
_NEAR = 12  # legs of each of many calls, to it and from it, that tables with a grid have
_BLOCK = 2048  # pairs of candidates predicted between two checks of the deadline: 10 ms
_PER_LEG = 10  # of them that each leg counts in addition
_KICKS_PER_CALL = 2  # of a local search; more of them hardly lower the cost of 30 calls


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """The costs of the legs of n calls, with at most h candidates of each.

    `candidates` are those of each call, shapes (h or less, k). `costs` has the shape
    (n + 1, h, n, h) and `end` the shape (n + 1, h), see `best_orders`.
    """

    candidates: Sequence[FloatArray]
    costs: FloatArray
    end: FloatArray


class OrderSearch:
    """The search for the orders of a chain that promise the least cost.

    Parameters
    ----------
    world, chain, ordering
        The request: the chain is a valid plan as it is.
    robot, models, objective
        What a leg costs.
    names, axes : sequences, one item per call
        Names and ranges of the free variables.
    allowed : callable, optional
        Limits the candidates.
    """

    def __init__(
        self,
        world: World,
        chain: TopChain,
        ordering: Ordering,
        robot: Robot,
        *,
        models: Mapping[str, PredictsPerformance],
        objective: Objective,
        names: Sequence[tuple[str, ...]],
        axes: Sequence[Sequence[Range]],
        allowed: Allowed | None,
    ) -> None:
        self._world = world
        self._chain = chain
        self._ordering = ordering
        self._robot = robot
        calls = zip(chain.calls, names, strict=True)
        self._names = [table_names(call, own) for call, own in calls]
        self._free = names
        self._axes = axes
        self._allowed = allowed
        self._legs = list(_legs(ordering))
        ends = [chain.calls[end] for _, end in self._legs]
        self._model = StepModel(
            leg_rows(world, chain, robot, self._names, self._legs, models),
            ends,
            [self._names[end] for _, end in self._legs],
            robot,
            models=models,
            objective=objective,
        )

    def chains(self, most: int, deadline: Deadline, work: Work) -> list[tuple[TopChain, float]]:
        """Return up to `most` orders of the chain with their costs, the least first.

        The order of the chain itself is one more, if it is not among them. The values of free
        variables are those of the grid. Empty if the deadline passed before the first order was
        found.
        """
        if deadline():
            return []
        calls = range(len(self._chain))
        grids = [[self._candidates(index, each) for index in calls] for each in (_COARSE, _FINE)]
        work.expected += sum(map(self._pairs, grids))
        if len(calls) >= _MANY:
            given = values_of(self._chain, self._names)
            grids.insert(0, [values[None] for values in given])
            work.expected += len(self._legs)
        possible = None
        if depends_on_order(self._chain) and self._is_exact:
            possible = possible_steps(
                self._chain, self._ordering, self._world, self._robot, deadline
            )
            if possible is None:
                return []
        found: tuple[_Table, list[LegOrder]] | None = None
        rough: FloatArray | None = None
        as_it_is = list(range(len(self._chain)))
        order = as_it_is
        for candidates in grids:
            table = self._table(candidates, rough, deadline, work)
            if table is None:
                break
            if self._is_exact:
                orders = best_orders(table.costs, self._ordering, possible, most, table.end)
            else:
                kicks = _KICKS_PER_CALL * len(calls) if candidates is grids[-1] else 0
                orders = self._improved(table, order, kicks, deadline)
            if all(each.order != tuple(as_it_is) for each in orders):
                as_sent = LocalSearch(table.costs, self._ordering, as_it_is, table.end)
                orders.append(as_sent.found())
                orders.sort(key=lambda each: each.cost)
            found = table, orders
            order = list(orders[0].order)
            if deadline():
                break
            if len(calls) >= _MANY and rough is None:
                rough = table.costs[:, 0, :, 0]
        if found is None:
            return []
        table, orders = found
        chains = [(self._written(table, each), each.cost) for each in orders]
        return [each for each in chains if not each[0].violations(self._world, self._robot)]

    @property
    def _is_exact(self) -> bool:
        return max(map(len, self._ordering.groups)) <= MOST_EXACT

    def _candidates(self, index: int, counts: Sequence[int]) -> FloatArray:
        call = self._chain.calls[index]
        values = goal_values(call.goal)
        free = self._free[index]
        others = [name for name in free if name != STOP]
        points = np.array([[values[name] for name in others]])
        may_stop = STOP in free or not call.passing
        if others and may_stop:
            named_axes = zip(free, self._axes[index], strict=True)
            axes = [axis for name, axis in named_axes if name != STOP]
            count = counts[min(len(others), len(counts) - 1)]
            allowed = while_stopping(self._allowed, free)
            found, _ = first_candidates(index, axes, count, allowed)
            points = found if len(found) else points
        if may_stop and STOP not in free:
            return points
        stopping = points if may_stop else points[:0]
        return with_passing(stopping, self._names[index], values, counts[1])

    def _pairs(self, candidates: Sequence[FloatArray]) -> int:
        """Return how many pairs of candidates a table has; an upper bound for many calls."""
        counts = [1, *map(len, candidates)]
        pairs = sum(counts[origin + 1] * counts[end + 1] for origin, end in self._legs)
        if len(candidates) < _MANY:
            return pairs
        return math.ceil(pairs * min(2 * _NEAR * len(counts) / len(self._legs), 1.0))

    def _table(
        self,
        candidates: Sequence[FloatArray],
        rough: FloatArray | None,
        deadline: Deadline,
        work: Work,
    ) -> _Table | None:
        """Return the table of predicted costs; None if the deadline passed before its end.

        Only legs that are cheap by `rough` costs (n + 1, n) are predicted; others have that cost.
        """
        width = max(map(len, candidates))
        costs = self._far(candidates, width, rough, deadline)
        if costs is None:
            return None
        starts = [np.zeros((1, 0)), *candidates]
        legs = list(enumerate(self._legs))
        if rough is not None:
            near = _near(rough)
            legs = [(number, leg) for number, leg in legs if near[leg[0] + 1, leg[1]]]
        block: list[Pairs] = []
        size = 0
        for number, (origin, end) in legs:
            before = starts[origin + 1]
            block.append((number, before[:, None], candidates[end]))
            size += len(before) * len(candidates[end])
            if size + _PER_LEG * len(block) < _BLOCK and number != legs[-1][0]:
                continue
            if deadline():
                return None
            found = self._model.step_costs(block)
            for (leg, first, second), of_leg in zip(block, found, strict=True):
                origin, end = self._legs[leg]
                is_possible = self._possible(origin, end, candidates)
                of_possible = np.where(is_possible, of_leg, np.inf)
                costs[origin + 1, : len(first), end, : len(second)] = of_possible
            work.add(size)
            block = []
            size = 0
        costs_at_end = costs_of_end(
            candidates, self._names, self._ordering, width, self._chain.calls
        )
        return _Table(candidates, costs, costs_at_end)

    def _far(
        self,
        candidates: Sequence[FloatArray],
        width: int,
        rough: FloatArray | None,
        deadline: Deadline,
    ) -> FloatArray | None:
        """Return the costs of a table before legs are predicted; None if the deadline passed.

        They are infinite, or the `rough` costs for candidates at which the robot stops, and for all
        of a call that it always passes.
        """
        count = len(candidates)
        if rough is None:
            return np.full((count + 1, width, count, width), np.inf)
        stops = np.zeros((count + 1, width), dtype=bool)
        stops[0, 0] = True
        for index, points in enumerate(candidates):
            passing = self._passing(index, candidates)
            stops[index + 1, : len(points)] = ~passing | passing.all()
        costs = np.empty((count + 1, width, count, width))
        for origin, legs in enumerate(costs):  # 0.1 s for 100 calls with many candidates
            if deadline():
                return None
            is_possible = stops[origin, :, None, None] & stops[1:]
            legs[:] = np.where(is_possible, rough[origin, None, :, None], np.inf)
        return costs

    def _possible(self, origin: int, end: int, candidates: Sequence[FloatArray]) -> BoolArray:
        """Return which pairs of candidates a leg may have, where the robot passes either call."""
        calls = self._chain.calls
        place = self._world.robot.pose[:2]
        starts = np.ones(1, dtype=bool)
        if origin >= 0:
            place = calls[origin].goal.robot_pose(self._robot)[:2]
            starts = np.ones(len(candidates[origin]), dtype=bool)
            if calls[origin].top.action != calls[end].top.action:
                starts = ~self._passing(origin, candidates)
        ends = np.ones(len(candidates[end]), dtype=bool)
        if may_pass(calls[end], self._names[end]):
            direction = arrival_heading(place, calls[end].goal.pose, self._robot)
            ends = reached(calls[end], candidates[end], self._names[end], direction)
        return starts[:, None] & ends

    def _passing(self, index: int, candidates: Sequence[FloatArray]) -> BoolArray:
        """Return with which of its candidates the robot passes a call."""
        return passing_rows(self._chain.calls[index], candidates[index], self._names[index])

    def _improved(
        self, table: _Table, order: Sequence[int], kicks: int, deadline: Deadline
    ) -> list[LegOrder]:
        """Return the order of a local search from the better of `order` and `nearest_next`."""
        starts = [order, nearest_next(table.costs, self._ordering)]
        searches = [LocalSearch(table.costs, self._ordering, start, table.end) for start in starts]
        search = min(searches, key=lambda each: each.cost)
        must_check = depends_on_order(self._chain)
        if must_check and self._violates(search):
            search = searches[0]
        self._climb(search, deadline, must_check=must_check)
        for _ in range(kicks):
            if deadline():
                break
            best = search.state()
            search.kick()
            is_valid = not (must_check and self._violates(search))
            if is_valid:
                self._climb(search, deadline, must_check=must_check)
            if not is_valid or search.cost >= best.cost:
                search.restore(best)
        return [search.found()]

    def _climb(self, search: LocalSearch, deadline: Deadline, *, must_check: bool) -> None:
        """Improve an order until no move does; with conditions, by moves that keep it valid."""
        cursor = 0
        rejected: set[int] = set()  # cursors behind moves that made the present order invalid
        while cursor >= 0 and not deadline():
            before = search.state()
            cursor = search.improve(cursor, 1 if must_check else MOST_TRIED)
            if not must_check or search.cost == before.cost:
                continue
            if self._violates(search):
                search.restore(before)
                if cursor in rejected:  # all moves were tried
                    return
                rejected.add(cursor)
            else:
                rejected.clear()

    def _violates(self, search: LocalSearch) -> bool:
        chain = self._chain.reordered(search.order.tolist())
        return bool(chain.violations(self._world, self._robot))

    def _written(self, table: _Table, found: LegOrder) -> TopChain:
        """Return the chain in an order, with its candidates; its last call stops.

        A call that is passed has an allowed heading all the same: the robot may miss it.
        """
        chain = self._chain
        for index, row in zip(found.order, found.rows, strict=True):
            candidate = table.candidates[index][row]
            columns = dict(zip(self._names[index], candidate, strict=True))
            values = {name: columns[name] for name in self._free[index]}
            if "yaw" in values:  # the direction in which it is passed may not be allowed
                headings = self._axes[index][self._free[index].index("yaw")]
                values["yaw"] = float(headings.nearest(np.array([values["yaw"]]))[0])
            if index == found.order[-1] and chain.calls[index].may_stop:
                values[STOP] = 1.0
            if values:
                chain = chain.with_goal(index, with_values(chain.calls[index].goal, values))
        return chain.reordered(found.order)


def _near(costs: FloatArray) -> BoolArray:
    """Return which legs are among the cheapest from their start or to their end, by (n + 1, n)."""
    shares = [np.argsort(np.argsort(costs, axis), axis) < _NEAR for axis in (0, 1)]
    return np.asarray(shares[0] | shares[1])


def _legs(ordering: Ordering) -> Iterator[tuple[int, int]]:
    """Yield the legs (from, to) of all orders; -1 is the start."""
    previous: Sequence[int] = (-1,)
    for group in ordering.groups:
        into = itertools.product(previous, group)
        within = itertools.permutations(group, 2)
        for origin, end in (*into, *within):
            if origin < 0 or not ordering.before[end, origin]:
                yield origin, end
        previous = group
