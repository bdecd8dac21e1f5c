"""Goals of plans as messages; everything that comes in is checked (see `checks`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ator_interfaces.msg import GoalTerm, PlanGoal
from ator_interfaces.srv import PlanChains
from ator_ros.nodes.messages import chain_of
from ator_ros.planning.wanted import MOST_STATEMENTS, Unspecified, Wish
from ator_ros.printable import quoted
from ator_ros.tops.chain import TopChain
from ator_ros.tops.conditions import Condition, Region
from ator_ros.world import messages
from ator_ros.world.messages import MessageError

_LARGEST = messages.FARTHEST


def is_asked_for(goal: PlanGoal) -> bool:
    """Return whether a goal says anything."""
    return bool(goal.name or goal.terms)


def wishes_from(
    goal: PlanGoal, named: Mapping[str, Condition], variables: Sequence[str], *, where: str = "goal"
) -> list[Wish]:
    """Read what shall hold at the end of a plan.

    Parameters
    ----------
    goal : PlanGoal
        A name or statements.
    named : mapping of str to Condition
        The goals that the domain names.
    variables : sequence of str
        The state variables that there are.
    """
    if goal.name and goal.terms:
        raise MessageError(f"{where}: expected a name or terms, got both")
    if goal.name:
        return list(named[messages.name(goal.name, f"{where}.name", allowed=named)].terms)
    messages.count(goal.terms, f"{where}.terms", least=1, most=MOST_STATEMENTS)
    return [_wish_from(term, variables, f"{where}.terms[{i}]") for i, term in enumerate(goal.terms)]


def _wish_from(term: GoalTerm, variables: Sequence[str], where: str) -> Wish:
    variable = messages.name(term.variable, f"{where}.variable", allowed=variables)
    value, low, high = (
        messages.number(getattr(term, name), f"{where}.{name}", low=-_LARGEST, high=_LARGEST)
        for name in ("value", "low", "high")
    )
    if low > high:
        raise MessageError(f"{where}: expected low <= high, got low {low:g} and high {high:g}")
    near = low == high == 0.0
    if not term.relative_to:
        return Unspecified(variable, value) if near else Region(variable, value, low, high)
    other = messages.name(term.relative_to, f"{where}.relative_to", allowed=variables)
    if other == variable:
        raise MessageError(f"{where}.relative_to: expected another variable, got {quoted(other)}")
    if near and value == 0.0:
        return Unspecified(variable, other)
    if near:
        raise MessageError(
            f"{where}: expected low and high of a value relative to another variable, got none"
        )
    return Region(variable, other, value + low, value + high)


def goal_of(wishes: Sequence[Wish]) -> PlanGoal:
    """Write what shall hold at the end of a plan."""
    return PlanGoal(terms=[_term_of(wish) for wish in wishes])


def _term_of(wish: Wish) -> GoalTerm:
    low, high = (0.0, 0.0)
    if isinstance(wish, Region):
        low, high = wish.low, wish.high
    elif not isinstance(wish, Unspecified):
        low, high = -wish.tolerance, wish.tolerance
    target = wish.target
    if isinstance(wish, Region) and wish.outward and not isinstance(target, str) and target < wish.centre:
        low, high = -high, -low
    if isinstance(target, str):
        return GoalTerm(variable=wish.variable, relative_to=target, low=low, high=high)
    return GoalTerm(variable=wish.variable, value=float(target), low=low, high=high)


def refused(reason: str) -> PlanChains.Response:
    """Return the answer to a goal without a plan."""
    return PlanChains.Response(reason=reason, computation_time=math.nan)


def answered(chains: Sequence[TopChain], *, action_set: str, frame: str) -> PlanChains.Response:
    """Return the answer to a goal; without chains it holds already."""
    return PlanChains.Response(
        accepted=True,
        holds=not chains,
        reason=f"{len(chains)} chains" if chains else "the goal holds already",
        chains=[chain_of(chain, action_set=action_set, frame=frame) for chain in chains],
    )
