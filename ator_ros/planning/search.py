"""Search of plans of symbolic problems: several alternatives, each with as few operators as possible."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from ator_ros.planning.goals import PlanningError

Plan = tuple[int, ...]
"""The indices of operators, in their order."""
MOST_SEARCHES, MOST_STATES = 60, 20_000
"""Bounds for one goal; the shipped domains need about ten searches of less than a hundred states."""


@dataclass(frozen=True, slots=True)
class Operator:
    """An operator of STRIPS: facts, by number, that must be true before, and are true or false after."""

    needs: frozenset[int]
    adds: frozenset[int]
    deletes: frozenset[int]

    def then(self, later: Operator) -> Operator:
        """Return the operator of this one followed by `later`."""
        return Operator(
            self.needs | (later.needs - self.adds),
            (self.adds - later.deletes) | later.adds,
            (self.deletes | later.deletes) - later.adds,
        )


@dataclass(frozen=True, slots=True)
class SymbolicProblem:
    """Operators, the initial facts, and the facts of the goal."""

    operators: tuple[Operator, ...]
    initial: frozenset[int]
    goal: frozenset[int]

    def within_reach(self) -> frozenset[int]:
        """Return the facts that are reachable if operators delete nothing."""
        reached, before = self.initial, None
        while reached != before:
            before = reached
            reached = reached.union(*(each.adds for each in self.operators if each.needs <= before))
        return reached

    def useful(self) -> list[int]:
        """Return the indices of operators on which the goal depends, directly or not."""
        needed, before = self.goal, None
        while needed != before:
            before = needed
            needed = needed.union(*(each.needs for each in self.operators if each.adds & before))
        return [number for number, each in enumerate(self.operators) if each.adds & needed]

    def plans(self, most: int) -> list[Plan]:
        """Return up to `most` plans, those with fewest operators first.

        Each further plan excludes an operator of each plan before. The sets of excluded operators form the
        hitting-set tree of Reiter (1987), which finds all plans that contain no other plan.

        Raises
        ------
        PlanningError
            More than `MOST_STATES` states were searched.
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
        """Return a plan with the fewest operators; of several, one that deletes fewest facts of the goal."""
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
