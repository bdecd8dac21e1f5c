"""Plans of symbolic problems, found with unified-planning and its engine pyperplan.

Importing unified-planning takes a second, so that this module is imported only where plans are searched.
"""

from __future__ import annotations

from collections.abc import Collection

from unified_planning.model import Fluent, InstantaneousAction, Problem
from unified_planning.shortcuts import OneshotPlanner, get_environment

from ator_ros.planning.enumeration import Solve
from ator_ros.planning.symbolic import Operator, Plan, SymbolicProblem

ENGINE = "pyperplan"
"""Of the engines from PyPI the one in Python: a plan takes it a millisecond, where others start a process."""


def solver_of(problem: SymbolicProblem) -> Solve:
    """Return what finds plans for a problem; see `Solve`."""
    get_environment().credits_stream = None  # a banner with each plan
    planner = OneshotPlanner(name=ENGINE)
    reached, useful = problem.within_reach(), problem.useful()
    numbers = [number for number in useful if problem.operators[number].needs <= reached]
    fluents = {fact: Fluent(f"f{fact}") for fact in sorted(reached)}
    actions = {number: _action(number, problem.operators[number], fluents) for number in numbers}

    def solve(banned: Collection[int]) -> Plan | None:
        posed = Problem("plan")
        for fact, fluent in fluents.items():
            posed.add_fluent(fluent, default_initial_value=fact in problem.initial)
        posed.add_actions([action for number, action in actions.items() if number not in banned])
        for fact in sorted(problem.goal):
            posed.add_goal(fluents[fact]())
        plan = planner.solve(posed).plan
        return None if plan is None else tuple(int(step.action.name[1:]) for step in plan.actions)

    return solve


def warm_up() -> None:
    """Find the plan of one step; what the first search imports takes as long as ten others."""
    step = Operator(frozenset(), frozenset({0}), frozenset())
    solver_of(SymbolicProblem((step,), frozenset(), frozenset({0})))(())


def _action(number: int, operator: Operator, fluents: dict[int, Fluent]) -> InstantaneousAction:
    action = InstantaneousAction(f"a{number}")
    for fact in sorted(operator.needs):
        action.add_precondition(fluents[fact]())
    for fact in sorted(operator.deletes & fluents.keys()):
        action.add_effect(fluents[fact](), False)
    for fact in sorted(operator.adds & fluents.keys()):
        action.add_effect(fluents[fact](), True)
    return action
