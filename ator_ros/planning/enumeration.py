"""Several plans from an engine that finds one: each further plan does without a step of those found.

The sets of steps that are left out form the hitting-set tree of Reiter (1987). It finds all plans of which
none consists of the steps of another one and more.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection

from ator_ros.planning.symbolic import Plan, SymbolicProblem

Solve = Callable[[Collection[int]], "Plan | None"]
"""Returns a plan without the operators whose numbers are given; None where there is none."""
MOST_SEARCHES = 60
"""Calls of the engine for one goal."""


def plans_of(problem: SymbolicProblem, solve: Solve, *, most: int) -> list[Plan]:
    """Return up to `most` plans, the shortest first, or nothing where there is none.

    Parameters
    ----------
    problem : SymbolicProblem
        What shall be achieved.
    solve : callable
        The engine.
    most : int
        Number of plans to stop at.
    """
    found: list[Plan] = []
    without: list[frozenset[int]] = []
    waiting, seen = deque([frozenset[int]()]), {frozenset[int]()}
    for _ in range(MOST_SEARCHES):
        banned = _next(waiting, without)
        if banned is None or len(found) >= most:
            break
        plan = next((each for each in found if not banned & set(each)), None)
        if plan is None:
            solved = solve(banned)
            if solved is None:
                without.append(banned)
                continue
            plan = problem.trimmed(solved)
            found.append(plan)
        for step in dict.fromkeys(plan):
            wider = banned | {step}
            if wider not in seen:
                seen.add(wider)
                waiting.append(wider)
    return sorted(found, key=len)


def _next(waiting: deque[frozenset[int]], without: list[frozenset[int]]) -> frozenset[int] | None:
    """Return the next set of steps to leave out; what cannot be left out alone cannot with others."""
    while waiting:
        banned = waiting.popleft()
        if not any(known <= banned for known in without):
            return banned
    return None
