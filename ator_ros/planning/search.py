"""Plans of symbolic problems: several alternatives, each with as few operators as possible."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from ator_ros.planning.goals import PlanningError

Plan = tuple[int, ...]
"""The numbers of operators, in their order."""
MOST_SEARCHES, MOST_STATES = 60, 20_000
"""For one goal; the shipped domains need some ten searches of less than a hundred states."""


@dataclass(frozen=True, slots=True)
class Operator:
    """What must be true before, and what is true and false afterwards: facts by number."""

    needs: frozenset[int]
    adds: frozenset[int]
    deletes: frozenset[int]

    def then(self, later: Operator) -> Operator:
        """Return the operator that does this and then `later`."""
        return Operator(
            self.needs | (later.needs - self.adds),
            (self.adds - later.deletes) | later.adds,
            (self.deletes | later.deletes) - later.adds,
        )


@dataclass(frozen=True, slots=True)
class SymbolicProblem:
    """Operators, the facts that are true at first, and those that shall be true at the end."""

    operators: tuple[Operator, ...]
    initial: frozenset[int]
    goal: frozenset[int]

    def within_reach(self) -> frozenset[int]:
        """Return the facts that could be made true if operators made nothing false."""
        reached, before = self.initial, None
        while reached != before:
            before = reached
            reached = reached.union(*(each.adds for each in self.operators if each.needs <= before))
        return reached

    def useful(self) -> list[int]:
        """Return the operators that a plan may need, by number: what the goal depends on, step by step."""
        needed, before = self.goal, None
        while needed != before:
            before = needed
            needed = needed.union(*(each.needs for each in self.operators if each.adds & before))
        return [number for number, each in enumerate(self.operators) if each.adds & needed]

    def plans(self, most: int) -> list[Plan]:
        """Return up to `most` plans, those with fewest operators first; nothing where there is none.

        Each further plan does without an operator of those found. The sets of operators that are left out
        form the hitting-set tree of Reiter (1987), which finds all plans of which none consists of the
        operators of another one and more.

        Raises
        ------
        PlanningError
            More states can be reached than are searched.
        """
        if not self.goal <= self.within_reach():
            return []
        found: list[Plan] = []
        unsolvable: list[frozenset[int]] = []
        waiting, seen = deque([frozenset[int]()]), {frozenset[int]()}
        useful, searches = self.useful(), 0
        while waiting and len(found) < most and searches < MOST_SEARCHES:
            banned = waiting.popleft()
            if any(known <= banned for known in unsolvable):
                continue
            searches += 1
            plan = next((each for each in found if not banned & set(each)), None)
            if plan is None:
                plan = self._best([number for number in useful if number not in banned])
                if plan is None:
                    unsolvable.append(banned)
                    continue
                found.append(plan)
            for step in dict.fromkeys(plan):
                if banned | {step} not in seen:
                    seen.add(banned | {step})
                    waiting.append(banned | {step})
        return sorted(found, key=len)

    def _best(self, usable: Sequence[int]) -> Plan | None:
        """Return a plan of the fewest operators; of several, one that undoes least of the goal."""
        ages = itertools.count()
        waiting: list[tuple[int, int, int, frozenset[int], Plan]] = [(0, 0, next(ages), self.initial, ())]
        done = set[frozenset[int]]()
        while waiting:
            _, undone, _, state, plan = heapq.heappop(waiting)
            if self.goal <= state:
                return plan
            if state in done:
                continue
            done.add(state)
            if len(done) > MOST_STATES:
                raise PlanningError(f"goal: expected at most {MOST_STATES} states on the way, got more")
            for number in usable:
                operator = self.operators[number]
                if operator.needs <= state:
                    after = (state - operator.deletes) | operator.adds
                    lost = undone + len(self.goal & state - after)
                    longer = (*plan, number)
                    heapq.heappush(waiting, (len(longer), lost, next(ages), after, longer))
        return None
