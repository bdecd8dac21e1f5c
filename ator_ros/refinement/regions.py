"""The regions of conditions as bounds of the candidates of a subgoal (paper, section 4.2).

A condition that puts a place within a distance of another, or a variable into a range, binds no goal
variable. It bounds those that decide on it: of all candidates only those are searched with which the next
step may begin, with room for what the step before may miss its goal by. Ways that are shorter or longer than
any that an action's model was learned from are not searched, either, where the place at which the way begins
is given: where that is free too, each place is bounded on its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import goal_values
from ator_ros.geometry import BoolArray, FloatArray, wrap_angles
from ator_ros.refinement.projection import columns_after, goal_columns
from ator_ros.refinement.sampled import Allowed
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain, projected
from ator_ros.tops.conditions import Condition, Region, Term, lookup
from ator_ros.tops.relations import Distance, Relation
from ator_ros.tops.state import state_of
from ator_ros.world.state import World

_PLACE = frozenset("xy")
Bound = Relation | Region


class _Rule(NamedTuple):
    """A bound of a subgoal's candidates.

    `whose` it is, the `room` to keep (in the unit of the bound), the `goal` that it speaks of (None for the
    subgoal's own), and whether it is about the state `before` the step.
    """

    whose: str
    bound: Bound
    room: float = 0.0
    goal: Mapping[str, float] | None = None
    before: bool = False


class Regions:
    """The bounds of the subgoals of a chain.

    Parameters
    ----------
    world, chain, robot
        The request.
    names : sequence of tuple of str, one per subgoal
        The free variables.
    models : mapping, optional
        Action name to performance model, which knows what ways were tried; an action may lack one.
    """

    def __init__(
        self,
        world: World,
        chain: TopChain,
        robot: Robot,
        names: Sequence[tuple[str, ...]],
        models: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self._world, self._chain, self._models = world, chain, models
        self._robot, self._names, self._calls = robot, names, chain.calls
        self._states: list[Mapping[str, float]] = []
        for call in chain.calls if _may_bound(chain, names) else ():
            self._states.append(state_of(world, robot))
            world = projected(world, call, robot)
        self._bounds = [self._bounds_of(index) for index in range(len(self._states))]

    def narrowed_to(self, names: Sequence[tuple[str, ...]]) -> Regions:
        """Return the same where only `names` are free."""
        return (
            self
            if names == self._names
            else Regions(self._world, self._chain, self._robot, names, self._models)
        )

    def allowing(self) -> Allowed | None:
        """Return what limits the candidates of the chain's subgoals; None where nothing does."""
        return self.allowed if any(self._bounds) else None

    def of_subgoal(self, chain: TopChain, index: int, names: tuple[str, ...]) -> Allowed | None:
        """Return what limits the candidates of one subgoal on its own, where only `names` are searched.

        Those before it are as in `chain`; those after it are as free as they were.
        """
        free = [*[()] * index, names, *self._names[index + 1 :]]
        regions = Regions(self._world, chain, self._robot, free, self._models)
        return (lambda _, values: regions.allowed(index, values)) if regions.bounds(index) else None

    def limits(self, index: int) -> tuple[str, ...]:
        """Return in words what bounds the candidates of a subgoal."""
        bounds = self._bounds[index] if self._bounds else ()
        return tuple(f"{rule.whose}: {_words(rule.bound)}" for rule in bounds)

    def bounds(self, index: int) -> bool:
        """Return whether anything bounds the candidates of a subgoal."""
        return bool(self._bounds and self._bounds[index])

    def allowed(self, index: int, values: FloatArray) -> BoolArray:
        """Return which candidates (n, k) of a subgoal all bounds allow, shape (n,)."""
        good = np.ones(len(values), dtype=bool)
        if not self.bounds(index):
            return good
        after, own = self._after(index, values)
        for rule in self._bounds[index]:
            good &= np.asarray(self._clearance(rule, index, after, own) >= rule.room)
        return good

    def _clearance(self, rule: _Rule, index: int, after: Mapping[str, Any], own: Mapping[str, Any]) -> Any:
        state = self._states[index] if rule.before else after
        return _clearance(rule.bound, state, own if rule.goal is None else rule.goal)

    def _bounds_of(self, index: int) -> list[_Rule]:
        """Return the bounds that the free variables of a subgoal decide on."""
        if not self._names[index]:
            return []
        rules = [*self._own_rules(index), *self._rules_of_next(index)]
        # What does not change with the candidates is no bound of theirs.
        probe = np.stack([np.zeros(len(self._names[index])), np.ones(len(self._names[index]))])
        after, own = self._after(index, probe)
        return [rule for rule in rules if np.ndim(self._clearance(rule, index, after, own)) > 0]

    def _own_rules(self, index: int) -> Iterator[_Rule]:
        """Yield the rules of the step that leads to a subgoal."""
        call = self._calls[index]
        step = f"of step {index + 1} ({call.top.name})"
        yield from (_Rule(f"post-condition {step}", bound) for bound in _bounds_in(call.top.post))
        if index and _PLACE & set(self._names[index - 1]):
            return  # where it starts is not known yet
        for bound in _bounds_in(call.top.pre):
            yield _Rule(f"pre-condition {step}", bound, before=True)
        way = experience_of(self._models.get(call.top.action)).get("way")
        if way is not None:
            start = "hold" if call.goal.point is Point.HOLD else "robot"
            yield _Rule(f"experience of {call.top.action}", Distance(start, "goal", *way), before=True)

    def _rules_of_next(self, index: int) -> Iterator[_Rule]:
        """Yield the rules of the step that begins at a subgoal."""
        if index + 1 == len(self._calls):
            return
        call, following = self._calls[index], self._calls[index + 1]
        whose = f"pre-condition of step {index + 2} ({following.top.name})"
        room, goal = call.top.place_tolerance, goal_values(following.goal)
        free = _PLACE & set(self._names[index + 1])
        for bound in _bounds_in(following.top.pre):
            if not (free and _names_goal(bound)):
                yield _Rule(whose, bound, room if _is_place(bound) else 0.0, goal)

    def _after(self, index: int, values: FloatArray) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return state and goal variables after a step whose goal has these free values (n, k)."""
        call, state = self._calls[index], dict[str, Any](self._states[index])
        goal: dict[str, Any] = dict(goal_columns(call.goal, self._names[index], values))
        if call.top.arrives:
            there = columns_after(goal, call.goal.point, self._robot)
            state |= {f"robot.{name}": there[name] for name in ("x", "y", "yaw", "v", "w")}
            state |= self._hold(call.goal.point, goal, there)
        for term in call.top.post.terms:
            if call.top.arrives and term.variable.partition(".")[0] in ("robot", "hold"):
                continue
            target: Any = lookup(term.target, state, goal) if isinstance(term.target, str) else term.target
            if target is not None:
                state[term.variable] = _placed(term, target)
        if not call.top.arrives and any(term.variable.startswith("robot.") for term in call.top.post.terms):
            state |= self._hold(
                Point.AXLE, goal, {name: state[f"robot.{name}"] for name in ("x", "y", "yaw")}
            )
        return state, goal

    def _hold(self, point: Point, goal: Mapping[str, Any], there: Mapping[str, Any]) -> dict[str, Any]:
        """Return where the hold is: exactly at the goal where that is meant for it, whatever the heading."""
        if point is Point.HOLD:
            return {"hold.x": goal["x"], "hold.y": goal["y"]}
        if self._robot.holder is None:
            return {}
        yaw, hold = there["yaw"], self._robot.hold
        return {"hold.x": there["x"] + hold * np.cos(yaw), "hold.y": there["y"] + hold * np.sin(yaw)}


def _may_bound(chain: TopChain, names: Sequence[tuple[str, ...]]) -> bool:
    """Return whether anything may bound a subgoal's candidates: a free place, or a condition beside it."""
    pairs = zip(names, chain.calls, [*chain.calls[1:], None], strict=True)
    return any(
        _PLACE & set(free)
        or _bounds_in(call.top.pre)
        or _bounds_in(call.top.post)
        or (after is not None and _bounds_in(after.top.pre))
        for free, call, after in pairs
        if free
    )


def _placed(term: Term | Region, target: Any) -> Any:
    """Return the value of a term's variable once it holds."""
    offset = term.offset(math.inf)
    if offset and isinstance(term, Region) and term.outward:
        return target + np.copysign(1.0, target - term.centre) * offset
    return target + offset if offset else target


def experience_of(model: Any) -> Mapping[str, tuple[float, float]]:
    """Return the ranges that a performance model was learned from, as far as it knows them."""
    known: Mapping[str, tuple[float, float]] = getattr(model, "experience", {})
    return known


def _bounds_in(condition: Condition) -> list[Bound]:
    ranges = [term for term in condition.terms if isinstance(term, Region) and term.bounds]
    return [*condition.relations, *ranges]


def _is_place(bound: Bound) -> bool:
    return not isinstance(bound, Region) or bound.variable.endswith((".x", ".y"))


def _names_goal(bound: Bound) -> bool:
    return not isinstance(bound, Region) and "goal" in bound.places


def _clearance(bound: Bound, state: Mapping[str, Any], goal: Mapping[str, Any]) -> Any:
    """Return by how much a bound holds, negative where it does not; what is unknown bounds nothing."""
    if not isinstance(bound, Region):
        clearance = bound.clearance(state, goal)
        return math.inf if clearance is None else clearance
    value: Any = state.get(bound.variable)
    if value is None:
        return math.inf
    difference = value - float(bound.target)
    if bound.variable.endswith("yaw"):
        difference = wrap_angles(difference)
    low, high = bound.reach(float(bound.target))
    return np.minimum(difference - low, high - difference)


def _words(bound: Bound) -> str:
    if not isinstance(bound, Region):
        return str(bound)
    beyond = " outward" if bound.outward else ""
    return f"{bound.variable} {bound.low:g} to {bound.high:g}{beyond} of {bound.target}"
