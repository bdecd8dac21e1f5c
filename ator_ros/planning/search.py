"""The search for plans in this process; the first call imports unified-planning, which takes a second."""

from __future__ import annotations

from ator_ros.planning.enumeration import plans_of
from ator_ros.planning.symbolic import Plan, SymbolicProblem


def search(problem: SymbolicProblem, most: int) -> list[Plan]:
    """Return up to `most` plans, the shortest first; nothing where there is none."""
    if not problem.goal <= problem.within_reach():
        return []
    from ator_ros.planning.engine import solver_of  # which imports unified-planning

    return plans_of(problem, solver_of(problem), most=most)
