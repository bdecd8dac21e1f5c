"""The free variables of a chain's subgoals and their bounds, computed (paper, section 4.2).

A goal variable is free if the plan opens it, it has a range, no condition binds it, every action
whose performance it may change has a performance model, and one of these models uses a direct
variable that it changes.

Free variables are bounded by their ranges and by the regions of conditions. The experience of the
models bounds nothing: where it ends, their uncertainty grows, and the gate decides.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import (
    GOAL_VARIABLES,
    ORDER,
    STOP,
    direct_name,
    goal_values,
)
from ator_ros.bases.description import Robot
from ator_ros.bases.direct import DirectTable
from ator_ros.geometry import BoolArray, FloatArray, Pose, wrap_angle
from ator_ros.refinement.chain_prediction import (
    PredictsPerformance,
    chain_situations,
    columns_after,
    with_candidates,
)
from ator_ros.refinement.search import Allowed, spread_over
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import EVERYTHING, InvalidChainError, TopCall, TopChain, projected
from ator_ros.tops.conditions import Condition, Region, Relation, state_of
from ator_ros.tops.ranges import USUAL_RANGES, Interval, Range, Ranges
from ator_ros.world.state import World

NEGLIGIBLE = 0.02
"""Share of a range below which a cut is ignored: random starts rarely reach its ends."""
_POINTS = 2048
# m, rad or m/s by which a value may leave the experience, besides `_ROOM` of its range
_SLACK = 0.05
_ROOM = 0.05  # share by which the extent of the points that a region allows is widened on each side
_ROUNDING = 1e-9  # m, rad or m/s: a value at the end of a region still fulfils the condition
_PLACE = frozenset("xy")
_SAME = 1e-6  # rounding error of a conversion to a message and back, in the variable's unit

Bound = Relation | Region


@dataclass(frozen=True, slots=True)
class FreeVariable:
    """One free variable: of which subgoal of the chain (counted from 0), its name, and its range.

    `limits` names the regions that narrow the range.
    """

    subgoal: int
    name: str
    domain: Range
    limits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class NotFree:
    """A variable that the plan opens and that is not free: subgoal (from 0), name, and why."""

    subgoal: int
    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class Analysis:
    """The free variables of a chain, and those that the plan opens and that are not free.

    `outside` are sentences about quantities of the chain that lie outside the models' experience.
    """

    free: tuple[FreeVariable, ...]
    not_free: tuple[NotFree, ...]
    outside: tuple[str, ...] = ()


def names_of(chain: TopChain, free: Sequence[FreeVariable]) -> list[tuple[str, ...]]:
    """Return the names of the free variables of each subgoal."""
    return [
        tuple(variable.name for variable in free if variable.subgoal == index)
        for index in range(len(chain.calls))
    ]


def _start_variables(name: str, point: Point) -> frozenset[str]:
    """Return the direct variables of the next action's start that a goal variable changes."""
    if name not in GOAL_VARIABLES:
        return frozenset()
    if name == "yaw" and point is Point.HOLD:
        return frozenset({"yaw", "x", "y"})
    return frozenset({"v" if name == "speed" else name})


def analyze(
    chain: TopChain,
    models: Mapping[str, PredictsPerformance],
    robot: Robot,
    ranges: Ranges = USUAL_RANGES,
    *,
    stops_decided: bool = False,
) -> Analysis:
    """Compute the free variables of a chain.

    Parameters
    ----------
    models : mapping
        Action name to performance model.
    ranges : mapping, optional
        Goal variable to its range; variables without one are never free.
    stops_decided : bool
        Whether it is decided where the robot stops: the heading of a call that it passes is not
        free then.
    """
    free: list[FreeVariable] = []
    not_free: list[NotFree] = []
    bound = bindings(tuple(call.top for call in chain.calls))
    for index, call in enumerate(chain.calls):
        known = list(goal_values(call.goal))
        for name in _opened(call, known):
            if stops_decided and (name == STOP or (name == "yaw" and call.passing)):
                continue
            domain = call.range_of(name, robot, ranges)
            reason = (
                bound.get((index, name))
                or _why_fixed(call, name, known, domain)
                or _why_it_stops(chain, index, name)
                or _why_unknown(chain, index, name, models)
            )
            if domain is None or reason is not None:
                not_free.append(NotFree(index, name, str(reason)))
            else:
                free.append(FreeVariable(index, name, domain, call.limits_of(name)))
    return Analysis(tuple(free), tuple(not_free))


def _opened(call: TopCall, known: Sequence[str]) -> list[str]:
    """Return the variables that a call opens: those `known` of its goal, then any other names."""
    if EVERYTHING in call.open:
        named = [name for name in known if name != STOP or STOP in call.open]
    else:
        named = [name for name in known if name in call.open]
    if STOP in call.open and STOP not in known and "speed" not in named:
        named.append("speed")
    return named + sorted(call.open - {EVERYTHING, ORDER, STOP, *known})


def _why_it_stops(chain: TopChain, index: int, name: str) -> str | None:
    """Return why the robot must stop at a call, or its heading does not matter as it passes."""
    call = chain.calls[index]
    if name == "yaw" and call.passing and not call.opens(STOP):
        return "not commanded where the robot passes"
    if name != STOP or ORDER in call.open:
        return None
    if index + 1 == len(chain):
        return "needed at the end of the chain"
    following = chain.calls[index + 1]
    if ORDER not in following.open and following.top.action != call.top.action:
        return f"needed before another action, {following.top.action}"
    return None


def _why_fixed(
    call: TopCall,
    name: str,
    known: Sequence[str],
    domain: Range | None,
) -> str | None:
    """Return why the call does not allow a variable to change."""
    if name not in known:
        return f"no goal variable, expected one of {', '.join(known)}"
    if not call.opens(name):
        by = f"the post-condition of {call.top.name}"
        return f'named by {by}: "{EVERYTHING}" leaves it, its own name opens it'
    if domain is None:
        return (
            "without an allowed value in its range" if call.limits_of(name) else "without a range"
        )
    return None


def _why_unknown(
    chain: TopChain,
    index: int,
    name: str,
    models: Mapping[str, PredictsPerformance],
) -> str | None:
    """Return why the effect of a variable on the performance is unknown."""
    changed = {index: frozenset({direct_name(name)})}
    following = _start_variables(name, chain.calls[index].goal.point)
    if following and index + 1 < len(chain.calls):
        changed[index + 1] = following
    actions = {step: chain.calls[step].top.action for step in changed}
    if any(changed[step] & models[actions[step]].used_variables for step in changed):
        return None
    return "used by no performance model of a neighboring action"


# Regions


class _Rule(NamedTuple):
    """A bound by a condition, the `source`, with a margin `room`.

    It refers to a `goal` (None: the subgoal's own) and, if `before`, to the state before the step.
    """

    source: str
    bound: Bound
    room: float = 0.0
    goal: Mapping[str, float] | None = None
    before: bool = False


class _RangeRule(NamedTuple):
    """A region that bounds one goal variable alone, the `source`, as an interval of its range."""

    source: str
    name: str
    interval: Interval


class Regions:
    """The regions that bound the candidates of a chain's subgoals.

    A condition on a distance, or on the range of a variable, binds no goal variable. It limits the
    candidates to those from which the next step may start, with a margin for the tolerance of the
    step before. A region that bounds a goal variable alone is a part of its range, as what the call
    allows is.

    Parameters
    ----------
    names : sequence of tuple of str, one per subgoal
        The free variables.
    """

    def __init__(
        self,
        world: World,
        chain: TopChain,
        robot: Robot,
        names: Sequence[tuple[str, ...]],
    ) -> None:
        self._world = world
        self._robot = robot
        self._names = names
        self._chain = chain
        self._bounds: list[list[_Rule]] = []
        self._ranges: list[list[_RangeRule]] = []
        for index in range(len(chain.calls)):
            rules = self._bounds_of(index)
            alone = [self._alone(rule, index) for rule in rules]
            self._ranges.append([each for each in alone if each is not None])
            pairs = zip(rules, alone, strict=True)
            self._bounds.append([rule for rule, each in pairs if each is None])

    @cached_property
    def _states(self) -> list[Mapping[str, float]]:
        """The state variables before each step: most chains have no regions that need them."""
        states: list[Mapping[str, float]] = []
        world = self._world
        for call in self._chain.calls:
            states.append(state_of(world, self._robot))
            world = projected(world, call, self._robot)
        return states

    @property
    def narrow(self) -> bool:
        """Whether any region bounds a candidate."""
        return any(self._bounds) or any(self._ranges)

    def narrowed(self, variable: FreeVariable) -> FreeVariable | NotFree:
        """Return a variable with the part of its range that the regions which bound it allow."""
        for source, name, interval in self._ranges[variable.subgoal]:
            if name != variable.name:
                continue
            domain = variable.domain.within([interval])
            if domain is None:
                return NotFree(variable.subgoal, name, f"without an allowed value: {source}")
            if domain != variable.domain:
                limits = (*variable.limits, source)
                variable = dataclasses.replace(variable, domain=domain, limits=limits)
        return variable

    def _alone(self, rule: _Rule, index: int) -> _RangeRule | None:
        """Return a rule as a part of a variable's range, if it bounds that variable alone."""
        bound = rule.bound
        top = self._chain.calls[index].top
        if rule.before or not isinstance(bound, Region) or not top.arrives:
            return None
        names = top.arrival().get(bound.variable, ())
        if len(names) != 1 or names[0] not in self._names[index]:
            return None
        target = float(bound.target)
        low, high = bound.reach(target)
        if names[0] == "yaw":
            low = max(low, -math.pi)
            high = min(high, math.pi)
        margin = rule.room + _ROUNDING
        interval = (target + low + margin, target + high - margin)
        return _RangeRule(f"{rule.source}: {bound}", names[0], interval)

    def allowing(self) -> Allowed | None:
        """Return the predicate for candidates of the chain's subgoals.

        None if nothing limits them.
        """
        return self.allowed if any(self._bounds) else None

    def of_subgoal(
        self,
        chain: TopChain,
        index: int,
        names: tuple[str, ...],
    ) -> Allowed | None:
        """Return the predicate for candidates of one subgoal, if only `names` of it are searched.

        The subgoals before it are fixed as in `chain`; those after it keep their free variables.
        """
        free = [*[()] * index, names, *self._names[index + 1 :]]
        regions = Regions(self._world, chain, self._robot, free)
        return (lambda _, values: regions.allowed(index, values)) if regions.limits(index) else None

    def limits(self, index: int) -> tuple[str, ...]:
        """Return a description of each bound of a subgoal's candidates."""
        return tuple(f"{rule.source}: {rule.bound}" for rule in self._bounds[index])

    def allowed(self, index: int, values: FloatArray) -> BoolArray:
        """Return which candidates (n, k) of a subgoal all bounds allow, shape (n,)."""
        good = np.ones(len(values), dtype=bool)
        if self._bounds[index]:
            after, own = self._after(index, values)
            for rule in self._bounds[index]:
                good &= np.asarray(self._clearance(rule, index, after, own) >= rule.room)
        return good

    def _clearance(
        self,
        rule: _Rule,
        index: int,
        after: Mapping[str, Any],
        own: Mapping[str, Any],
    ) -> Any:
        state = self._states[index] if rule.before else after
        margin = rule.bound.clearance(state, own if rule.goal is None else rule.goal)
        return math.inf if margin is None else margin

    def _bounds_of(self, index: int) -> list[_Rule]:
        """Return the bounds that the free variables of a subgoal decide on."""
        count = len(self._names[index])
        rules = list(self._rules(index)) if count else []
        if not rules:
            return []
        # A bound that does not depend on the candidates cannot limit them.
        two_candidates = np.stack([np.zeros(count), np.ones(count)])
        after, own = self._after(index, two_candidates)
        return [rule for rule in rules if np.ndim(self._clearance(rule, index, after, own)) > 0]

    def _rules(self, index: int) -> Iterator[_Rule]:
        """Yield the bounds by the step that leads to a subgoal, and by the step after it."""
        calls = self._chain.calls
        call = calls[index]
        step = f"of {self._chain.step_name(index)}"
        for bound in _bounds_in(call.top.post):
            yield _Rule(f"post-condition {step}", bound)
        start_is_known = index == 0 or not _PLACE & set(self._names[index - 1])
        if start_is_known:
            for bound in _bounds_in(call.top.pre):
                yield _Rule(f"pre-condition {step}", bound, before=True)
        if index + 1 == len(calls):
            return
        following = calls[index + 1]
        source = f"pre-condition of {self._chain.step_name(index + 1)}"
        room = call.top.place_tolerance
        goal = goal_values(following.goal)
        goal_is_free = bool(_PLACE & set(self._names[index + 1]))
        for bound in _bounds_in(following.top.pre):
            if isinstance(bound, Region):
                is_place = bound.variable.endswith((".x", ".y"))
                yield _Rule(source, bound, room if is_place else 0.0, goal)
            elif not (goal_is_free and "goal" in bound.places):
                yield _Rule(source, bound, room, goal)

    def _after(self, index: int, values: FloatArray) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return state and goal variables after a step whose goal has these free values (n, k)."""
        call = self._chain.calls[index]
        goal = with_candidates(goal_values(call.goal), self._names[index], values)
        before = self._states[index]
        if not call.top.arrives:
            state = call.top.post.apply(before, goal)
            moves = any(term.variable.startswith("robot.") for term in call.top.post.terms)
            return state | (self._hold(state) if moves else {}), goal
        there = columns_after(goal, call.goal.point, self._robot)
        arrival = {f"robot.{name}": value for name, value in there.items()}
        if call.goal.point is Point.HOLD:  # the hold is at the goal, whatever the heading
            arrival |= {"hold.x": goal["x"], "hold.y": goal["y"]}
        else:
            arrival |= self._hold(arrival)
        return call.top.post.apply({**before, **arrival}, goal) | arrival, goal

    def _hold(self, state: Mapping[str, Any]) -> dict[str, Any]:
        yaw = state["robot.yaw"]
        hold = self._robot.hold
        ahead = {"hold.x": hold * np.cos(yaw), "hold.y": hold * np.sin(yaw)}
        places = {name: state[f"robot.{name[-1]}"] + offset for name, offset in ahead.items()}
        return places if self._robot.holder is not None else {}


def _bounds_in(condition: Condition) -> list[Bound]:
    ranges = [term for term in condition.terms if isinstance(term, Region) and term.bounds]
    return [*condition.relations, *ranges]


# Experience


def experience_of(model: Any) -> Mapping[str, tuple[float, float]]:
    """Return the ranges of the episodes that a performance model was trained on, if it has them."""
    ranges: Mapping[str, tuple[float, float]] = getattr(model, "experience", {})
    return ranges


class _Quantity(NamedTuple):
    """A quantity of a step that is compared with the experience of its action.

    Open variables of the subgoals before and after the step with these names change it.
    """

    name: str  # in the experience
    label: str
    unit: str
    before: frozenset[str]
    after: frozenset[str]


_HEADING = frozenset({"yaw"})
_SPEED = frozenset({"speed"})
_QUANTITIES = (
    _Quantity("way", "distance", "m", _PLACE, _PLACE),
    _Quantity("turn", "turn", "rad", _HEADING, _HEADING),
    _Quantity("v", "speed at the start", "m/s", _SPEED, frozenset()),
    _Quantity("speedg", "arrival speed", "m/s", frozenset(), _SPEED),
)


def outside_experience(
    world: World,
    chain: TopChain,
    models: Mapping[str, PredictsPerformance],
    robot: Robot,
) -> tuple[str, ...]:
    """Return sentences about distances, turns and speeds outside the experience of the models.

    Those that open variables change are left out.
    """
    sentences = []
    opened_before: frozenset[str] = frozenset()
    situations = chain_situations(world, chain, robot, models)
    pairs = zip(chain.calls, situations, strict=True)
    for step, (call, direct) in enumerate(pairs):
        known = experience_of(models[call.top.action])
        opened = frozenset(name for name in GOAL_VARIABLES if call.opens(name))
        values = _quantities(direct, robot)
        for name, label, unit, before, after in _QUANTITIES:
            is_open = before & opened_before or after & opened
            if is_open or name not in known or _is_near(values[name], *known[name]):
                continue
            low, high = known[name]
            sentences.append(
                f"{chain.step_name(step)}: {label} {values[name]:.1f} {unit} is outside "
                f"the experience of {low:.1f} to {high:.1f} {unit}"
            )
        opened_before = opened
    return tuple(sentences)


def _quantities(direct: DirectTable, robot: Robot) -> dict[str, float]:
    """Return the values of `_QUANTITIES` in one situation."""
    row = direct.table[:, 0].tolist()
    numbers = dict(zip(direct.names, row, strict=True))
    ahead = robot.hold * numbers["hold"] if robot.holder is not None else 0.0
    start = Pose(numbers["x"], numbers["y"], numbers["yaw"]).ahead(ahead)
    way = math.hypot(numbers["xg"] - start.x, numbers["yg"] - start.y)
    turn = abs(wrap_angle(numbers["yawg"] - numbers["yaw"]))
    return {"way": way, "turn": turn, "v": numbers["v"], "speedg": numbers["speedg"]}


def _is_near(
    value: float,
    low: float,
    high: float,
) -> bool:
    """Return whether a value is in the experience, or hardly outside."""
    slack = _SLACK + (_ROOM * (high - low) if math.isfinite(high - low) else 0.0)
    return low - slack <= value <= high + slack


def within_regions(
    analysis: Analysis,
    regions: Regions,
    chain: TopChain,
) -> Analysis:
    """Return `analysis` with the ranges narrowed to the candidates that the regions allow.

    If a region allows none, the variables of the subgoal are not free.
    """
    free: list[FreeVariable] = []
    not_free = list(analysis.not_free)
    for index in range(len(chain.calls)):
        own = [regions.narrowed(each) for each in analysis.free if each.subgoal == index]
        variables = [each for each in own if isinstance(each, FreeVariable)]
        not_free += [each for each in own if isinstance(each, NotFree)]
        limits = regions.limits(index) if variables else ()
        if not limits:
            free += variables
            continue
        points = spread_over([variable.domain for variable in variables], _POINTS)
        points = points[regions.allowed(index, points)]
        if not len(points):
            why = f"without an allowed value: {'; '.join(limits)}"
            not_free += [NotFree(index, variable.name, why) for variable in variables]
            continue
        for variable, column in zip(variables, points.T, strict=True):
            room = _ROOM * float(np.ptp(column))
            narrowed = variable
            if not variable.domain.periodic:
                low = float(column.min()) - room
                high = float(column.max()) + room
                narrowed = _narrowed(variable, low, high, limits)
            free.append(narrowed)
    return dataclasses.replace(analysis, free=tuple(free), not_free=tuple(not_free))


def _narrowed(
    variable: FreeVariable,
    low: float,
    high: float,
    limits: tuple[str, ...],
) -> FreeVariable:
    """Return the variable with its range cut to `low` to `high`, unless the cut is negligible."""
    domain = variable.domain
    width = domain.high - domain.low
    low = max(low, domain.low)
    high = min(high, domain.high)
    cut = max(low - domain.low, domain.high - high)
    narrowed = domain.within([(low, high)])
    if cut <= NEGLIGIBLE * width or low >= high or narrowed is None:
        return variable
    return dataclasses.replace(variable, domain=narrowed, limits=variable.limits + limits)


# Changes


def allowed_changes(
    plan: TopChain,
    refined: TopChain,
    robot: Robot,
    ranges: Ranges,
) -> list[dict[str, float]]:
    """Return, step by step, the goal variables that `refined` changes, with their new values.

    Raises InvalidChainError if it has other steps or goal variables than `plan`, it changes a
    variable that `plan` does not open or that a condition binds, or a value is not in the
    variable's range.
    """
    if [call.top for call in plan.calls] != [call.top for call in refined.calls]:
        raise InvalidChainError("expected the steps of the question")
    bound = bindings(tuple(call.top for call in plan.calls))
    changes = []
    pairs = zip(plan.calls, refined.calls, strict=True)
    for step, (old, new) in enumerate(pairs):
        if old.goal.values.keys() != new.goal.values.keys():
            where = f"step {step + 1} ({old.top.name})"
            raise InvalidChainError(f"{where}: expected the goal variables of the question")
        planned = goal_values(old.goal)
        values = goal_values(new.goal)
        values = {
            name: value
            for name, value in values.items()
            if not same_value(name, planned[name], value)
        }
        for name, value in values.items():
            where = f"{name} of step {step + 1} ({old.top.name})"
            allowed = old.range_of(name, robot, ranges)
            if not old.opens(name):
                expected = f"{planned[name]:g} as planned"
            elif (step, name) in bound:
                expected = f"no change, it is {bound[step, name]}"
            elif allowed is None:
                expected = "no change, it has no range"
            elif allowed.contains(value):
                continue
            else:
                expected = f"a number in {allowed}"
            raise InvalidChainError(f"{where}: expected {expected}, got {value:g}")
        changes.append(values)
    return changes


def same_value(
    name: str,
    old: float,
    new: float,
) -> bool:
    """Return whether two values of a goal variable are the same, headings up to whole turns."""
    difference = new - old if math.isfinite(new) else math.inf
    return (
        abs(wrap_angle(difference) if name == "yaw" and difference < math.inf else difference)
        <= _SAME
    )
