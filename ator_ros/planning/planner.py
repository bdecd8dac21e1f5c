"""Chains for a goal, from the conditions of the TOPs in a library."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ator_ros.execution.fence import Fence
from ator_ros.planning.chains import chain_of
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.explanation import why_unreachable
from ator_ros.planning.facts import Fact
from ator_ros.planning.operators import steps_for
from ator_ros.planning.posed import Posed, posed
from ator_ros.planning.symbolic import Plan, SymbolicProblem
from ator_ros.planning.wanted import Wish, checked, facts_of, known_variables
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.tops.chain import Top, TopChain, projected
from ator_ros.tops.conditions import state_of
from ator_ros.tops.library import TopLibrary, driving_top
from ator_ros.tops.objects import missing_object
from ator_ros.world.state import World

MOST_CHAINS = 8
"""Chains for one goal: as many as a request to refinement may hold."""
_MOST_PLANS = 16
"""Plans of symbols that are searched: some have no place for a step."""

Search = Callable[[SymbolicProblem, int], Sequence[Plan]]
"""Returns up to so many plans of a problem, the shortest first; nothing where there is none."""


@dataclass(frozen=True, slots=True)
class PlanningTask:
    """A goal in a situation, as symbols.

    Attributes
    ----------
    world, library
        What was asked.
    wanted : tuple of Fact
        What shall hold.
    posed : Posed
        The problem for an engine.
    left_out : tuple of str
        Why TOPs of the library are not used.
    fence : Fence
        Where the chains may lead.
    """

    world: World
    library: TopLibrary
    wanted: tuple[Fact, ...]
    posed: Posed
    left_out: tuple[str, ...]
    fence: Fence

    @property
    def holds(self) -> bool:
        """Whether the goal holds already."""
        state = state_of(self.world, self.library.robot)
        return all(fact.holds_in(state) for fact in self.wanted)

    def chains(self, plans: Sequence[Plan]) -> list[TopChain]:
        """Return the chains of plans that an engine has found, those with fewest steps first.

        Raises
        ------
        PlanningError
            There is none; the message names the condition that no TOP achieves, or why no plan can be used.
        """
        if not plans:
            raise PlanningError("; ".join([*self.left_out, why_unreachable(self.posed)]))
        found: list[TopChain] = []
        reasons: list[str] = []
        for plan in plans:
            try:
                found.append(self._chain(plan))
            except PlanningError as error:
                reasons.append(str(error))
        if not found:
            raise PlanningError("; ".join(dict.fromkeys(reasons)))
        return sorted(found, key=len)[:MOST_CHAINS]

    def _chain(self, plan: Plan) -> TopChain:
        """Return the chain of a plan; raises PlanningError where it is no valid plan from the situation."""
        steps = [step for number in plan for step in self.posed.steps[number]]
        names = ", ".join(step.top.name for step in steps)
        if len(steps) > LONGEST_CHAIN:
            raise PlanningError(f"plan of {len(steps)} steps: expected at most {LONGEST_CHAIN}")
        chain = chain_of(steps, self.world, self.library, self.fence)
        if out := self.fence.violation(chain, self.library.robot):
            raise PlanningError(out)
        world, robot = self.world, self.library.robot
        reasons = chain.violations(world, robot)
        for call in chain.calls:
            world = projected(world, call, robot)
        state = state_of(world, robot)
        reasons += [f"at the end: {why}" for fact in self.wanted if (why := fact.violation(state))]
        if reasons:
            raise PlanningError(f"plan {names}: {reasons[0]}")
        return chain


def task_for(
    wishes: Sequence[Wish],
    world: World,
    library: TopLibrary,
    objects: Sequence[str],
    fence: Fence | None = None,
) -> PlanningTask:
    """Return the planning task of a goal.

    Parameters
    ----------
    wishes : sequence
        What shall hold at the end.
    world, library
        The situation, and the TOPs to plan with.
    objects : sequence of str
        Names of the objects that the domain knows.
    fence : Fence, optional
        Where the chains may lead; by default around the scene's area.

    Raises
    ------
    PlanningError
        The goal names what there is not, or the problem is too large.
    """
    robot = library.robot
    checked(wishes, known_variables(objects, holder=robot.holder is not None))
    unfit = {top.name: why for top in library.values() if (why := _unfit(top, world, library))}
    unfit |= library.left_out
    tops = [top for top in library.values() if top.name not in unfit]
    wanted = facts_of(wishes, tops)
    driving = driving_top(library)
    if driving is not None and driving.name in unfit:
        driving = None
    problem = posed(wanted, steps_for(wanted, tops), driving, world, robot)
    fence = fence or Fence.around(robot)
    return PlanningTask(world, library, tuple(wanted), problem, tuple(unfit.values()), fence)


def _unfit(top: Top, world: World, library: TopLibrary) -> str | None:
    """Return why a TOP cannot be used; None where it can."""
    if why := top.lacks(library.robot):
        return why
    if missing := missing_object(top, world):
        return f"{top.name} needs the {missing}, which is unknown"
    return None


def chains_for(
    wishes: Sequence[Wish],
    world: World,
    library: TopLibrary,
    objects: Sequence[str],
    search: Search,
    fence: Fence | None = None,
) -> list[TopChain]:
    """Return chains for a goal, those with fewest steps first; none where it holds already.

    Parameters
    ----------
    wishes, world, library, objects, fence
        See `task_for`.
    search : callable
        The engine; `ator_ros.planning.search` has one.

    Raises
    ------
    PlanningError
        There is no plan inside the fence, or the goal cannot be used.
    """
    task = task_for(wishes, world, library, objects, fence)
    if task.holds:
        return []
    return task.chains(search(task.posed.problem, _MOST_PLANS))
