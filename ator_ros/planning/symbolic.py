"""Planning problems of symbols alone: facts by number, and operators that make them true and false."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

MOST_FACTS, MOST_OPERATORS = 200, 200
"""Larger problems are refused: none of a domain of a dozen TOPs comes near."""

Plan = tuple[int, ...]
"""The numbers of operators, in their order."""


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

    def achieves(self, plan: Sequence[int]) -> bool:
        """Return whether a plan can be executed and all of the goal is true at its end."""
        state = self.initial
        for number in plan:
            operator = self.operators[number]
            if not operator.needs <= state:
                return False
            state = (state - operator.deletes) | operator.adds
        return self.goal <= state

    def trimmed(self, plan: Sequence[int]) -> Plan:
        """Return a plan without the steps that it does not need."""
        kept = tuple(plan)
        for index in range(len(kept) - 1, -1, -1):
            shorter = (*kept[:index], *kept[index + 1 :])
            kept = shorter if self.achieves(shorter) else kept
        return kept

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
