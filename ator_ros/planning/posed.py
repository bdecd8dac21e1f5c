"""The symbolic problem of a goal: which facts there are, and what each step makes of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ator_ros.planning.detours import far_side
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.facts import Fact, placed_thing, resolved
from ator_ros.planning.operators import PlannedStep
from ator_ros.planning.symbolic import MOST_FACTS, MOST_OPERATORS, Operator, SymbolicProblem
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import State, state_of
from ator_ros.tops.objects import fetched
from ator_ros.world.state import World


@dataclass(frozen=True, slots=True)
class Posed:
    """A symbolic problem, and the steps that its operators stand for.

    Attributes
    ----------
    facts : tuple of Fact
        By number; after these come those that say that a region holds an object from the start.
    steps : tuple
        Of each operator, the steps of the chain: none for leaving an object where it is.
    problem : SymbolicProblem
        What the engine is given.
    """

    facts: tuple[Fact, ...]
    steps: tuple[tuple[PlannedStep, ...], ...]
    problem: SymbolicProblem


class _Poser:
    def __init__(
        self, wanted: Sequence[Fact], steps: Sequence[PlannedStep], world: World, robot: Robot
    ) -> None:
        needs = [fact for step in steps for fact in step.needs()]
        self.facts = list(dict.fromkeys((*wanted, *needs)))
        self.numbers = {fact: number for number, fact in enumerate(self.facts)}
        self.state: State = state_of(world, robot)
        self.initial = {number for fact, number in self.numbers.items() if fact.holds_in(self.state)}
        self.steps: list[tuple[PlannedStep, ...]] = []
        self.operators: list[Operator] = []

    def add(self, operator: Operator, *steps: PlannedStep) -> None:
        if operator not in self.operators:
            self.operators.append(operator)
            self.steps.append(steps)

    def operator(self, step: PlannedStep) -> Operator:
        """Return what a step needs and does."""
        values = step.values()
        adds, deletes = set[int](), set[int]()
        for fact, number in self.numbers.items():
            if fact.depends & values.keys():
                (adds if fact.holds_after(values) else deletes).add(number)
        needs = frozenset(self.numbers[fact] for fact in step.needs())
        return Operator(needs, frozenset(adds), frozenset(deletes))

    def regions(self) -> list[frozenset[int]]:
        """Return the facts that one region consists of, for each region that holds its object at first."""
        names = dict.fromkeys(fact.region for fact in self.facts if fact.region)
        groups = (frozenset(n for fact, n in self.numbers.items() if fact.region == name) for name in names)
        return [group for group in groups if group <= self.initial]


def posed(
    wanted: Sequence[Fact], steps: Sequence[PlannedStep], driving: Top | None, world: World, robot: Robot
) -> Posed:
    """Return the symbolic problem of a goal.

    That an object lies in a region at first counts once a plan leaves it there, which is an operator
    without steps: plans that leave it are then told from plans that move it.

    Parameters
    ----------
    wanted, steps
        What shall hold, and the steps to choose from.
    driving : Top or None
        What drives the robot to a pose: with it an object that lies where it is needed may also be
        approached from its far side.
    world, robot
        The situation.

    Raises
    ------
    PlanningError
        The problem is too large.
    """
    poser = _Poser(wanted, steps, world, robot)
    operators = [poser.operator(step) for step in steps]
    regions = poser.regions()
    here = {len(poser.facts) + number: group for number, group in enumerate(regions)}
    initial = frozenset(poser.initial) - frozenset().union(*regions) | here.keys()
    for step, operator in zip(steps, operators, strict=True):
        moved = frozenset(
            number for number, group in here.items() if group & (operator.deletes | operator.adds)
        )
        poser.add(Operator(operator.needs, operator.adds, operator.deletes | moved), step)
    for number, group in here.items():
        poser.add(Operator(frozenset({number}), group, frozenset()))
    goal = frozenset(poser.numbers[fact] for fact in wanted)
    plain = SymbolicProblem(tuple(poser.operators), initial, goal)
    useful = [poser.operators[number].needs for number in plain.useful()]
    for group in (group for group in regions if any(group <= needs for needs in useful)):
        for step, detour in _detours(poser, group, steps, driving, world, robot):
            both = poser.operator(detour).then(poser.operator(step))
            poser.add(Operator(both.needs | group, both.adds, both.deletes), detour, step)
    if len(poser.facts) + len(here) > MOST_FACTS or len(poser.operators) > MOST_OPERATORS:
        raise PlanningError(
            f"goal: expected TOPs from which at most {MOST_OPERATORS} steps and {MOST_FACTS} conditions "
            f"follow, got {len(poser.operators)} and {len(poser.facts)}"
        )
    return Posed(
        tuple(poser.facts), tuple(poser.steps), SymbolicProblem(tuple(poser.operators), initial, goal)
    )


def _detours(
    poser: _Poser,
    group: frozenset[int],
    steps: Sequence[PlannedStep],
    driving: Top | None,
    world: World,
    robot: Robot,
) -> Iterator[tuple[PlannedStep, PlannedStep]]:
    """Yield the steps that fetch what lies in a region, each with a drive to the far side of it before."""
    fact = poser.facts[min(group)]
    thing, goal = placed_thing(fact.said), resolved(dict(fact.binding), poser.state)
    if driving is None or thing is None or not goal.keys() >= {"x", "y"}:
        return
    for step in steps:
        if fetched(step.top) == thing:
            there = far_side(world, robot, thing, (goal["x"], goal["y"]))
            if there is not None:
                yield step, PlannedStep(driving, (("x", there[0]), ("y", there[1])))
