"""Why a goal is out of reach: the condition that no TOP can achieve."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ator_ros.planning.posed import Posed
from ator_ros.planning.values import difference, is_chosen, target_of
from ator_ros.tops.conditions import Statement


def why_unreachable(posed: Posed) -> str:
    """Return which condition no TOP achieves, or that no sequence of TOPs achieves all at once."""
    problem = posed.problem
    reached = problem.within_reach()
    missing = sorted(problem.goal - reached)
    if not missing:
        goal = " and ".join(str(posed.facts[number]) for number in sorted(problem.goal))
        return f"each condition can be achieved, but no sequence of TOPs ends with {goal}"
    return "; ".join(_why(posed, number, reached) for number in missing)


def _why(posed: Posed, number: int, reached: frozenset[int]) -> str:
    """Return why one fact is out of reach, down to the first that no TOP achieves."""
    said, asked = [], {number}
    while True:
        achieving = [
            index
            for index, each in enumerate(posed.problem.operators)
            if number in each.adds and posed.steps[index]
        ]
        needed = next(
            (
                (index, need)
                for index in achieving
                for need in sorted(posed.problem.operators[index].needs - reached - asked)
                if need < len(posed.facts)
            ),
            None,
        )
        if needed is None:
            said.append(f"no TOP achieves {posed.facts[number]}{_nearly(posed, number)}")
            return ", ".join(reversed(said))
        index, number = needed
        asked.add(number)
        name = posed.steps[index][-1].top.name
        said.append(f"which {name} needs" if len(said) == 0 else f"for {name}")


def _nearly(posed: Posed, number: int) -> str:
    """Return which TOPs bring the variable of a fact to its target, but not as near as that."""
    fact = posed.facts[number]
    if not isinstance(fact.said, Statement):
        return ""
    found = dict.fromkeys(_reaches(posed, number))
    return f" ({', '.join(found)})" if found else ""


def _reaches(posed: Posed, number: int) -> Sequence[str]:
    fact = posed.facts[number]
    assert isinstance(fact.said, Statement)
    said = []
    for step in (step for steps in posed.steps for step in steps):
        values = step.values()
        value = values.get(fact.said.variable)
        if value is None or is_chosen(value.symbol):
            continue
        target = target_of(fact.said, values, dict(fact.binding), step.top.name)
        if difference(fact.said.variable, value, target) == 0.0:
            low, high = value.low - target.high, value.high - target.low
            if low <= high and math.isfinite(high - low):
                said.append(f"{step.top.name} brings it to {low:g} to {high:g} of that")
    return said
