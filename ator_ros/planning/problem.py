"""The symbolic planning problem of a goal: candidate steps, their effects, and the search."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ator_ros.planning.facts import (
    AXES,
    Fact,
    Symbol,
    Value,
    after,
    difference,
    placed_thing,
    preconditions,
    region_name,
)
from ator_ros.planning.goals import GoalStatement, PlanningError, Unspecified
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Region, State, Statement
from ator_ros.tops.objects import followed

Plan = tuple[int, ...]
"""Indices of operators."""
# Bounds for one goal; the shipped domains need about ten searches of less than a hundred states.
_MOST_SEARCHES = 60
_MOST_STATES = 20_000  # in each search
_MOVING = ("robot.", "hold.")  # variables that are no destination, as they change during a step


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """A TOP with a goal.

    Attributes
    ----------
    top : Top
    binding : tuple of pairs
        Names and symbols of the goal variables; missing ones are chosen later.
    region : tuple of Fact
        Facts that a later TOP needs at the chosen place; empty if no place is chosen.
    """

    top: Top
    binding: tuple[tuple[str, Symbol], ...] = ()
    region: tuple[Fact, ...] = ()

    def needs(self) -> list[Fact]:
        """Return its preconditions."""
        return preconditions(self.top, dict(self.binding))

    def values(self) -> dict[str, Value]:
        """Return the variables that it changes."""
        return after(self.top, dict(self.binding))


def facts_of(goal: Sequence[GoalStatement], tops: Sequence[Top]) -> list[Fact]:
    """Return a goal as facts.

    Statements without a tolerance get the smallest that `tops` achieve.
    """
    facts = []
    for statement in goal:
        if isinstance(statement, Unspecified):
            low, high = _smallest_range(statement, tops)
            statement = Region(
                statement.variable,
                statement.target,
                low,
                high,
            )
        facts.append(Fact(statement, surely=True))
    return facts


def _smallest_range(statement: Unspecified, tops: Sequence[Top]) -> tuple[float, float]:
    """Return the smallest range around the target that a TOP achieves; 0, 0 if none does."""
    ranges = []
    for top in tops:
        value = _achieved(statement, top)
        if value is not None and math.isfinite(value.high - value.low):
            ranges.append((value.low, value.high))
    return min(
        ranges,
        key=lambda ends: ends[1] - ends[0],
        default=(0.0, 0.0),
    )


def _achieved(statement: Unspecified, top: Top) -> Value | None:
    """Return the variable after a TOP, relative to the target; None if that is unknown."""
    for binding in ({}, _reaching([statement], top)):
        values = after(top, binding)
        value = values.get(statement.variable)
        target = values.get(str(statement.target))
        target = target or Value(statement.target)
        if value is not None and difference(statement.variable, value, target) is not None:
            return Value(
                value.symbol,
                value.low - target.high,
                value.high - target.low,
            )
    return None


def _reaching(goal: Sequence[GoalStatement], top: Top) -> dict[str, Symbol]:
    """Return the goal with which a TOP achieves the most statements; empty if it achieves none."""
    names = {*top.pre.goal_names(), *top.post.goal_names(), *AXES, "speed"}
    values = after(top, {name: f"goal.{name}" for name in names})
    found: dict[str, Symbol] = {}
    for statement in goal:
        symbol = values[statement.variable].symbol if statement.variable in values else ""
        name = str(symbol).removeprefix("goal.")
        is_goal_variable = symbol == f"goal.{name}" and name in names
        target = statement.target
        if is_goal_variable and not str(target).startswith(_MOVING):
            found.setdefault(name, target if isinstance(target, str) else float(target))
    return found


def steps_for(goal: Sequence[Fact], tops: Sequence[Top]) -> list[PlannedStep]:
    """Return candidate steps: TOPs with goals.

    The goal of a TOP is the place of the object that it follows, a place in the goal of the plan,
    or a place from which another of these steps may start.
    """
    groups: dict[str, list[Statement]] = {}  # by robot, hold or object
    for fact in goal:
        if isinstance(fact.clause, Statement):
            owner = fact.clause.variable.partition(".")[0]
            groups.setdefault(owner, []).append(fact.clause)
    direct: list[PlannedStep] = []
    statements = list(groups.values())
    for top in tops:
        direct += [PlannedStep(top, binding) for binding in _bindings(top, statements)]
    near: list[PlannedStep] = []
    for top in tops:
        for target in direct:
            near += _toward(top, target)
    return list(dict.fromkeys((*direct, *near)))


def _bindings(
    top: Top, groups: Sequence[Sequence[Statement]]
) -> Iterator[tuple[tuple[str, Symbol], ...]]:
    """Yield goals of `top`: at the object that it follows, and for each group that it reaches."""
    name = followed(top)
    own: dict[str, Symbol] = {} if name is None else {"x": f"{name}.x", "y": f"{name}.y"}
    places_something = top.arrives or bool(top.post.goal_names() & {"x", "y"})
    if own or not places_something:
        yield tuple(sorted(own.items()))
    for group in groups:
        if found := _reaching(group, top):
            yield tuple(sorted({**found, **own}.items()))


def _toward(top: Top, target: PlannedStep) -> Iterator[PlannedStep]:
    """Yield `top` with goals from which `target` may start, one for each thing that it needs."""
    if followed(top) is not None:
        return
    facts = target.needs()
    things = [placed_thing(fact.clause) for fact in facts]
    for thing in dict.fromkeys(filter(None, things)):
        region = region_name(target.top, dict(target.binding), thing)
        binding = tuple((axis, f"{region}.{axis}") for axis in "xy")
        step = PlannedStep(
            top,
            binding,
            tuple(fact for fact in facts if fact.region == region),
        )
        placed = {name: value.symbol for name, value in step.values().items()}
        if all(placed.get(f"{thing}.{axis}") == symbol for axis, symbol in binding):
            yield step


@dataclass(frozen=True, slots=True)
class Operator:
    """An operator of STRIPS: the numbers of the facts that it needs, adds and deletes."""

    needs: frozenset[int]
    adds: frozenset[int]
    deletes: frozenset[int]


@dataclass(frozen=True, slots=True)
class PlanningProblem:
    """A STRIPS problem.

    Attributes
    ----------
    facts : tuple of Fact
        Facts by number. Higher numbers mean that a region contains an object from the start.
    steps : tuple of PlannedStep or None
        The step of each operator; None if the operator leaves an object in its region.
    operators : tuple of Operator
        What may be done.
    initial, goal : frozenset of int
        Numbers of the facts that hold at the start, and must hold at the end.
    """

    facts: tuple[Fact, ...]
    steps: tuple[PlannedStep | None, ...]
    operators: tuple[Operator, ...]
    initial: frozenset[int]
    goal: frozenset[int]

    def within_reach(self) -> frozenset[int]:
        """Return the facts that would be reachable if operators deleted nothing."""
        reached = self.initial
        before = None
        while reached != before:
            before = reached
            reached = reached.union(*(each.adds for each in self.operators if each.needs <= before))
        return reached

    def useful(self) -> list[int]:
        """Return the indices of operators on which the goal depends, directly or indirectly."""
        needed = self.goal
        before = None
        while needed != before:
            before = needed
            needed = needed.union(*(each.needs for each in self.operators if each.adds & before))
        return [number for number, each in enumerate(self.operators) if each.adds & needed]

    def plans(self, most: int) -> list[Plan]:
        """Return up to `most` plans, those with fewest operators first.

        Each further plan excludes an operator of each plan before. The sets of excluded operators
        form the hitting-set tree of Reiter (1987), which finds all plans that contain no other
        plan.

        Raises
        ------
        PlanningError
            More than `_MOST_STATES` states were searched.
        """
        if not self.goal <= self.within_reach():
            return []
        found: list[Plan] = []
        unsolvable: list[frozenset[int]] = []
        waiting = deque([frozenset[int]()])
        seen = {frozenset[int]()}
        useful = self.useful()
        searches = 0
        while waiting and len(found) < most and searches < _MOST_SEARCHES:
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
        """Return a plan with the fewest operators; of several, one that undoes least."""
        ages = itertools.count()
        waiting: list[tuple[int, int, int, frozenset[int], Plan]] = [
            (0, 0, next(ages), self.initial, ())
        ]
        done = set[frozenset[int]]()
        while waiting:
            _, undone, _, state, plan = heapq.heappop(waiting)
            if self.goal <= state:
                return plan
            if state in done:
                continue
            done.add(state)
            if len(done) > _MOST_STATES:
                raise PlanningError(
                    f"goal: expected at most {_MOST_STATES} states to search, got more"
                )
            for number in usable:
                operator = self.operators[number]
                if operator.needs <= state:
                    after = (state - operator.deletes) | operator.adds
                    lost = undone + len(self.goal & state - after)
                    longer = (*plan, number)
                    heapq.heappush(waiting, (len(longer), lost, next(ages), after, longer))
        return None


def planning_problem(
    goal: Sequence[Fact],
    steps: Sequence[PlannedStep],
    state: State,
) -> PlanningProblem:
    """Return the symbolic problem of a goal.

    Leaving an object in its region is an operator of its own, so that plans that move it are
    alternatives.

    Parameters
    ----------
    goal : sequence of Fact
        Facts that must hold at the end.
    steps : sequence of PlannedStep
        Candidate steps.
    state : State
        State variables at the start, see `state_of`.
    """
    needs = [fact for step in steps for fact in step.needs()]
    facts = list(dict.fromkeys((*goal, *needs)))
    numbers = {fact: number for number, fact in enumerate(facts)}
    true = {number for fact, number in numbers.items() if fact.violation(state) is None}
    names = dict.fromkeys(fact.region for fact in facts if fact.region)
    regions = [
        frozenset(number for fact, number in numbers.items() if fact.region == name)
        for name in names
    ]
    # Numbers of the facts that a region contains an object from the start, with the facts of the
    # region.
    filled = [region for region in regions if region <= true]
    contained = dict(enumerate(filled, start=len(facts)))
    operators: dict[Operator, PlannedStep | None] = {}
    for step in steps:
        values = step.values()
        adds = set[int]()
        deletes = set[int]()
        for fact, number in numbers.items():
            if fact.depends & values.keys():
                (adds if fact.holds_after(values) else deletes).add(number)
        moved = {number for number, group in contained.items() if group & (deletes | adds)}
        needed = frozenset(numbers[fact] for fact in step.needs())
        operator = Operator(needed, frozenset(adds), frozenset(deletes | moved))
        operators.setdefault(operator, step)
    for number, group in contained.items():
        operators.setdefault(Operator(frozenset({number}), group, frozenset()), None)
    initial = frozenset(true).difference(*contained.values()) | frozenset(contained)
    wanted = frozenset(numbers[fact] for fact in goal)
    return PlanningProblem(
        tuple(facts),
        tuple(operators.values()),
        tuple(operators),
        initial,
        wanted,
    )
