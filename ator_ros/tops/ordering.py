"""The orders in which the calls of a chain may be executed.

Calls that follow each other and open `ORDER` form a group, within which they may change places. A
call that does not open it keeps its place, as a group of its own. `TopCall.after` restricts the
orders further, and so do the conditions: in each step the pre-condition must hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ator_ros.actions.goal_variables import ORDER, goal_values
from ator_ros.bases.description import Robot
from ator_ros.geometry import BoolArray
from ator_ros.tops.chain import InvalidChainError, TopChain, projected
from ator_ros.tops.conditions import state_of
from ator_ros.world.state import ObjectState, RobotState, World

_MOST_TRIED = 5000  # steps that are tried to find a valid order: about 0.3 s
_MOST_LISTED = 3  # conditions that the reason for no valid order names

_Objects = tuple[tuple[str, ObjectState], ...]
_Worlds = dict[int, dict[_Objects, World]]  # after a last call (-1: the start), by their objects


@dataclass(frozen=True, slots=True, eq=False)
class Ordering:
    """What a chain says about the order of its n calls.

    Attributes
    ----------
    groups : tuple of tuple of int
        The calls that may change places with each other, group by group; each call is in one.
    before : ndarray of bool, shape (n, n)
        Element [i, j]: call i must come before call j because of a precedence, directly or not.
    """

    groups: tuple[tuple[int, ...], ...]
    before: BoolArray

    @property
    def is_open(self) -> bool:
        """Whether any call may change its place."""
        return any(len(group) > 1 for group in self.groups)

    def fault(self, order: Sequence[int]) -> str | None:
        """Return why calls may not be executed in an order of their indices; None if they may."""
        count = len(self.before)
        if sorted(order) != list(range(count)):
            return f"expected each index from 0 to {count - 1} once, got {list(order)}"
        first = 0
        for group in self.groups:
            placed = order[first : first + len(group)]
            if set(placed) != set(group):
                places = f"places {first + 1} to {first + len(group)}"
                return f"expected calls {list(group)} at {places}, got {list(placed)}"
            first += len(group)
        for number, late in enumerate(order):
            early = [index for index in order[number + 1 :] if self.before[index, late]]
            if early:
                return f"expected call {late} after call {early[0]}"
        return None


def ordering_of(chain: TopChain) -> Ordering:
    """Return the groups and precedences of a chain.

    Raises InvalidChainError as `ordering_of_calls` does.
    """
    return ordering_of_calls(
        [call.top.name for call in chain.calls],
        [ORDER in call.open for call in chain.calls],
        [call.after for call in chain.calls],
    )


def ordering_of_calls(
    names: Sequence[str], is_open: Sequence[bool], after: Sequence[Sequence[int]]
) -> Ordering:
    """Return the groups and precedences of calls.

    Parameters
    ----------
    names : sequence of str
        The TOPs of the calls, for messages.
    is_open : sequence of bool
        Whether each call opens its place.
    after : sequence of sequence of int
        Indices of the calls that must come before each.

    Raises
    ------
    InvalidChainError
        A precedence names an unknown call, cannot hold because a call keeps its place, or is part
        of a circle.
    """
    count = len(names)
    groups: list[tuple[int, ...]] = []
    for index in range(count):
        joins = index > 0 and is_open[index] and is_open[index - 1]
        if joins:
            groups[-1] = (*groups[-1], index)
        else:
            groups.append((index,))
    group_of = {index: number for number, group in enumerate(groups) for index in group}
    before = np.zeros((count, count), dtype=bool)
    for index, others in enumerate(after):
        where = f"step {index + 1} ({names[index]})"
        for other in others:
            if not 0 <= other < count or other == index:
                raise InvalidChainError(
                    f"{where}: after: expected indices of other calls, 0 to {count - 1}, "
                    f"got {other}"
                )
            if group_of[other] > group_of[index]:
                raise InvalidChainError(
                    f"{where}: after: it cannot come after step {other + 1} "
                    f"({names[other]}), which keeps a later place; open the order of both "
                    "and of all steps between them"
                )
            before[other, index] = True
    if before.any():
        for index in range(count):  # the transitive closure (Warshall)
            before |= before[:, index, None] & before[None, index]
        circle = np.flatnonzero(before.diagonal())
        if circle.size:
            steps = ", ".join(str(index + 1) for index in circle)
            raise InvalidChainError(f"after: expected no circle, got one of steps {steps}")
    return Ordering(tuple(groups), before)


def depends_on_order(chain: TopChain) -> bool:
    """Return whether any pre-condition may fail in one order and hold in another."""
    return any(call.top.pre.terms or call.top.pre.relations for call in chain.calls)


def in_valid_order(
    chain: TopChain,
    world: World,
    robot: Robot,
    deadline: Callable[[], bool] = lambda: False,
) -> TopChain:
    """Return the chain, in the first order in which it is a valid plan if it is none as it is.

    Raises InvalidChainError with the reasons if none is found until the deadline.
    """
    ordering = ordering_of(chain)
    violations = chain.violations(world, robot)
    if not violations:
        return chain
    if not ordering.is_open or any(call.top.lacks(robot) for call in chain.calls):
        raise InvalidChainError("; ".join(violations))
    search = _Search(chain, ordering, robot, deadline)
    order = search.order_from(world)
    if order is None:
        where = "in none of the orders that were tried" if search.was_cut_short else "in no order"
        raise InvalidChainError(f"{where}: {search.reasons()}")
    return chain.reordered(order)


class _Search:
    """Depth-first search for the first valid order, which backtracks where no step can follow."""

    def __init__(
        self,
        chain: TopChain,
        ordering: Ordering,
        robot: Robot,
        deadline: Callable[[], bool],
    ) -> None:
        self._chain = chain
        self._deadline = deadline
        self._calls = chain.calls
        self._before = ordering.before
        self._robot = robot
        self._group_at = [group for group in ordering.groups for _ in group]
        self._tried = 0
        self._dead_ends: set[tuple[frozenset[int], RobotState, _Objects, tuple[int, ...]]] = set()
        self._deepest = -1
        self._violations: list[str] = []
        self.was_cut_short = False

    def reasons(self) -> str:
        """Return the conditions that end the longest valid beginnings of an order."""
        listed = list(dict.fromkeys(self._violations))
        more = f"; and {len(listed) - _MOST_LISTED} more" if len(listed) > _MOST_LISTED else ""
        return "; ".join(listed[:_MOST_LISTED]) + more

    def order_from(self, world: World, done: tuple[int, ...] = ()) -> tuple[int, ...] | None:
        """Return the first valid order that begins with the calls `done`, after which `world` is.

        None if there is none.
        """
        if len(done) == len(self._calls):
            return done
        passed = done[-1:] if done and self._calls[done[-1]].passing else ()
        situation = (frozenset(done), world.robot, _objects(world), passed)
        if situation in self._dead_ends:
            return None
        left = [index for index in self._group_at[len(done)] if index not in done]
        for index in left:
            if any(self._before[other, index] for other in left):
                continue
            self._tried += 1
            if self._tried > _MOST_TRIED or self._deadline():
                self.was_cut_short = True
                return None
            if fault := self._fault(world, done, index):
                self._record(len(done), fault)
                continue
            after = projected(world, self._calls[index], self._robot)
            found = self.order_from(after, (*done, index))
            if found is not None:
                return found
        self._dead_ends.add(situation)
        return None

    def _fault(self, world: World, done: tuple[int, ...], index: int) -> str:
        """Return why a call cannot follow those `done`, after which `world` is; empty if it can."""
        call = self._calls[index]
        state = state_of(world, self._robot)
        violations = call.top.pre.violations(state, goal_values(call.goal))
        if violations:
            return f"pre-condition of {self._chain.step_name(index)}: {violations[0]}"
        fault = self._calls[done[-1]].stop_fault(call) if done else None
        if fault:
            return f"{self._chain.step_name(done[-1])}: passing: {fault}"
        fault = call.stop_fault(None) if len(done) + 1 == len(self._calls) else None
        return f"{self._chain.step_name(index)}: passing: {fault}" if fault else ""

    def _record(self, depth: int, fault: str) -> None:
        if depth > self._deepest:
            self._deepest = depth
            self._violations = []
        if depth == self._deepest:
            self._violations.append(fault)


def possible_steps(
    chain: TopChain,
    ordering: Ordering,
    world: World,
    robot: Robot,
    deadline: Callable[[], bool],
) -> list[BoolArray] | None:
    """Return, group by group, which calls may follow in each situation, by their pre-conditions.

    None if the deadline passed before the end.

    Element [done, last, j] of a group's array, shape (2**m, n + 1, m): whether the group's j-th
    call may follow call `last` - 1 (0: the start) after those calls of the group whose bits `done`
    has. Where objects may lie in several places, one of them suffices: an order that this allows
    must still be checked.
    """
    calls = chain.calls
    found = []
    entries: _Worlds = {-1: {_objects(world): world}}
    for group in ordering.groups:
        size = len(group)
        needed = [sum(1 << k for k, i in enumerate(group) if ordering.before[i, j]) for j in group]
        possible = np.zeros((1 << size, len(calls) + 1, size), dtype=bool)
        reached: list[_Worlds] = [{} for _ in range(1 << size)]
        reached[0] = entries
        for done, last, number in _extensions(reached, needed):
            if deadline():
                return None
            call = calls[group[number]]
            for there in reached[done][last].values():
                state = state_of(there, robot)
                if call.top.pre.violations(state, goal_values(call.goal)):
                    continue
                possible[done, last + 1, number] = True
                after = projected(there, call, robot)
                worlds = reached[done | 1 << number].setdefault(group[number], {})
                worlds.setdefault(_objects(after), after)
        found.append(possible)
        entries = reached[-1]
    return found


def _extensions(
    reached: Sequence[_Worlds], needed: Sequence[int]
) -> Iterator[tuple[int, int, int]]:
    """Yield each set of calls that was reached, its last call, and each call that may be next."""
    for done, worlds in enumerate(reached):
        for last in worlds:
            for number, others in enumerate(needed):
                if not done >> number & 1 and not others & ~done:
                    yield done, last, number


def _objects(world: World) -> _Objects:
    return tuple(sorted(world.objects.items()))
