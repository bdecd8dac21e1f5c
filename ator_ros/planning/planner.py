"""Chains for a goal, from the conditions of the TOPs in a library."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ator_ros.execution.fence import Fence
from ator_ros.planning.chains import chain_of
from ator_ros.planning.facts import Fact, difference, is_chosen, target_of
from ator_ros.planning.goals import GoalStatement, PlanningError, check_goal, known_variables
from ator_ros.planning.problem import PlannedStep, PlanningProblem, facts_of, planning_problem, steps_for
from ator_ros.refinement.refiner import LONGEST_CHAIN, MOST_ALTERNATIVES
from ator_ros.tops.chain import Top, TopChain, projected
from ator_ros.tops.conditions import Statement, state_of
from ator_ros.tops.library import TopLibrary, driving_top
from ator_ros.tops.objects import missing_object
from ator_ros.world.state import World

MOST_CHAINS = 1 + MOST_ALTERNATIVES
"""Chains for one goal: as many as a request to refinement may hold."""
_MOST_PLANS = 16
"""Symbolic plans that are searched; some cannot be used as there is no place for a step."""


def chains_for(
    goal: Sequence[GoalStatement],
    world: World,
    library: TopLibrary,
    objects: Sequence[str],
    fence: Fence | None = None,
) -> list[TopChain]:
    """Return chains for a goal, those with fewest steps first; none if it holds already.

    Parameters
    ----------
    goal : sequence
        Statements that shall hold at the end.
    world, library
        The situation, and the TOPs to plan with.
    objects : sequence of str
        Names of the objects that the domain has.
    fence : Fence, optional
        Bounds of the chains; by default around the scene's area.

    Raises
    ------
    PlanningError
        The goal cannot be used, or there is no plan inside the fence. The message names the condition that
        no TOP achieves, or why no plan can be used.
    """
    robot = library.robot
    check_goal(goal, known_variables(objects, holder=robot.holder is not None))
    unfit = {top.name: why for top in library.values() if (why := _unfit(top, world, library))}
    unfit |= library.left_out
    tops = [top for top in library.values() if top.name not in unfit]
    facts, state = facts_of(goal, tops), state_of(world, robot)
    if all(fact.violation(state) is None for fact in facts):
        return []
    driving = driving_top(library)
    if driving is not None and driving.name in unfit:
        driving = None
    problem = planning_problem(facts, steps_for(facts, tops), driving, world, robot)
    plans = problem.problem.plans(_MOST_PLANS)
    if not plans:
        raise PlanningError("; ".join([*unfit.values(), _why_unreachable(problem)]))
    found: list[TopChain] = []
    reasons: list[str] = []
    for plan in plans:
        steps = [step for number in plan for step in problem.steps[number]]
        try:
            found.append(_valid_chain(steps, facts, world, library, fence or Fence.around(robot)))
        except PlanningError as error:
            reasons.append(str(error))
    if not found:
        raise PlanningError("; ".join(dict.fromkeys(reasons)))
    return sorted(found, key=len)[:MOST_CHAINS]


def _unfit(top: Top, world: World, library: TopLibrary) -> str | None:
    """Return why a TOP cannot be used; None if it can."""
    if why := top.lacks(library.robot):
        return why
    missing = missing_object(top, world)
    return f"{top.name} needs the {missing}, which is unknown" if missing else None


def _valid_chain(
    steps: Sequence[PlannedStep], goal: Sequence[Fact], world: World, library: TopLibrary, fence: Fence
) -> TopChain:
    """Return the chain of a plan; raises PlanningError if it is no valid plan from the situation."""
    robot = library.robot
    if len(steps) > LONGEST_CHAIN:
        raise PlanningError(f"plan of {len(steps)} steps: expected at most {LONGEST_CHAIN}")
    chain = chain_of(steps, world, library, fence)
    if out := fence.violation(chain, robot):
        raise PlanningError(out)
    reasons = chain.violations(world, robot)
    for call in chain.calls:
        world = projected(world, call, robot)
    state = state_of(world, robot)
    reasons += [f"at the end: {why}" for fact in goal if (why := fact.violation(state))]
    if reasons:
        raise PlanningError(f"plan {', '.join(step.top.name for step in steps)}: {reasons[0]}")
    return chain


def _why_unreachable(problem: PlanningProblem) -> str:
    """Return which condition no TOP achieves, or that no sequence of TOPs achieves all at once."""
    symbols = problem.problem
    reached = symbols.within_reach()
    if missing := sorted(symbols.goal - reached):
        return "; ".join(_why(problem, number, reached) for number in missing)
    goal = " and ".join(str(problem.facts[number]) for number in sorted(symbols.goal))
    return f"each condition can be achieved, but no sequence of TOPs ends with {goal}"


def _why(problem: PlanningProblem, number: int, reached: frozenset[int]) -> str:
    """Return why a fact cannot be reached, down to the first one that no TOP achieves."""
    because: list[str] = []
    asked = {number}
    while True:
        needed = next(
            (
                (steps[-1].top.name, need)
                for steps, operator in zip(problem.steps, problem.problem.operators, strict=True)
                if steps and number in operator.adds
                for need in sorted(operator.needs - reached - asked)
                if need < len(problem.facts)
            ),
            None,
        )
        if needed is None:
            because.append(f"no TOP achieves {problem.facts[number]}{_nearest(problem, number)}")
            return ", ".join(reversed(because))
        name, number = needed
        asked.add(number)
        because.append(f"for {name}" if because else f"which {name} needs")


def _nearest(problem: PlanningProblem, number: int) -> str:
    """Return the TOPs that bring the variable of a fact to its target, with their tolerances."""
    fact, found = problem.facts[number], dict[str, None]()
    if not isinstance(fact.clause, Statement):
        return ""
    for step in (step for steps in problem.steps for step in steps):
        values = step.values()
        value = values.get(fact.clause.variable)
        if value is None or is_chosen(value.symbol):
            continue
        target = target_of(fact.clause, values, dict(fact.binding), step.top.name)
        low, high = value.low - target.high, value.high - target.low
        same = difference(fact.clause.variable, value, target) == 0.0
        if same and low <= high and math.isfinite(high - low):
            found[f"{step.top.name} brings it to {low:g} to {high:g} of that"] = None
    return f" ({', '.join(found)})" if found else ""
