"""The free variables of a chain's subgoals and their bounds (paper, section 4.2): computed, not listed.

A goal variable is free if the plan opens it, it has a range, no condition binds it, every action
whose performance it may change has a performance model, and one of these models uses a direct
variable that it changes.

Free variables are bounded by their ranges, by the regions of conditions, and by the experience of
the models: values well outside the starts and goals that a model was trained on are not searched.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import GOAL_VARIABLES, direct_name, goal_values
from ator_ros.bases.description import Robot
from ator_ros.geometry import BoolArray, FloatArray, Pose, wrap_angle
from ator_ros.refinement.chain_prediction import (
    PredictsPerformance,
    chain_situations,
    columns_after,
)
from ator_ros.refinement.search import Allowed, spread_points
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import EVERYTHING, InvalidChainError, TopChain, projected
from ator_ros.tops.conditions import Condition, Distance, Region, Relation, state_of
from ator_ros.tops.ranges import USUAL_RANGES, Range, Ranges
from ator_ros.world.state import World

NEGLIGIBLE = 0.02
"""Share of a range below which a cut is ignored: random starts never reach the ends of their ranges."""
_POINTS = 2048
# m, rad or m/s by which a value may leave the experience, besides `_ROOM` of its range
_SLACK = 0.05
_ROOM = 0.05  # share by which the extent of the points that a region allows is widened on each side
_PLACE = frozenset("xy")
_SAME = 1e-6  # rounding error of a conversion to a message and back, in the variable's unit

Bound = Relation | Region


@dataclass(frozen=True, slots=True)
class FreeVariable:
    """One free variable: of which subgoal of the chain (counted from 0), its name, and its range.

    `limits` names what narrows the range: regions, and the experience of the models.
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
    """Return the direct variables of the next action's start that the goal variable `name` changes."""
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
) -> Analysis:
    """Compute the free variables of a chain.

    Parameters
    ----------
    models : mapping
        Action name to performance model; an action may lack one.
    ranges : mapping, optional
        Goal variable to its range; variables without one are never free.
    """
    free: list[FreeVariable] = []
    not_free: list[NotFree] = []
    bound = bindings(tuple(call.top for call in chain.calls))
    for index, call in enumerate(chain.calls):
        known = list(goal_values(call.goal))
        opened = known if EVERYTHING in call.open else [name for name in known if name in call.open]
        for name in opened + sorted(call.open - {EVERYTHING, *known}):
            reason = bound.get((index, name))
            if reason is None and name not in known:
                reason = f"no goal variable, expected one of {', '.join(known)}"
            elif reason is None and not call.opens(name):
                by = f"the post-condition of {call.top.name}"
                reason = f'named by {by}: "{EVERYTHING}" leaves it, its own name opens it'
            elif reason is None and name not in ranges:
                reason = "without a range"
            reason = reason or _why_unknown(chain, index, name, models)
            if reason is None:
                free.append(FreeVariable(index, name, ranges[name](robot, call.goal)))
            else:
                not_free.append(NotFree(index, name, reason))
    return Analysis(tuple(free), tuple(not_free))


def _why_unknown(
    chain: TopChain, index: int, name: str, models: Mapping[str, PredictsPerformance]
) -> str | None:
    """Return why the effect of a variable on the performance is unknown."""
    changed = {index: frozenset({direct_name(name)})}
    following = _start_variables(name, chain.calls[index].goal.point)
    if following and index + 1 < len(chain.calls):
        changed[index + 1] = following
    actions = {step: chain.calls[step].top.action for step in changed}
    lacking = [step for step, action in actions.items() if action not in models]
    if lacking:
        step = lacking[0]
        return f"of unknown effect: step {step + 1} ({actions[step]}), which it may change, has no model"
    if any(changed[step] & models[actions[step]].used_variables for step in changed):
        return None
    return "used by no performance model of a neighboring action"


# Regions


class _Rule(NamedTuple):
    """A bound by a condition or model, the `source`, with a margin `room`.

    It refers to a `goal` (None: the subgoal's own) and, if `before`, to the state before the step.
    """

    source: str
    bound: Bound
    room: float = 0.0
    goal: Mapping[str, float] | None = None
    before: bool = False


class Regions:
    """The regions that bound the candidates of a chain's subgoals.

    A condition on a distance, or on the range of a variable, binds no goal variable. It limits the
    candidates to those from which the next step may start, with a margin for the tolerance of the
    step before. The distance to drive is limited to the experience of the action's model, unless
    the place at which the step starts is free too: then each place is bounded separately.

    Parameters
    ----------
    names : sequence of tuple of str, one per subgoal
        The free variables.
    models : mapping
        Action name to performance model, which has the range of experienced distances; an action
        may lack one.
    """

    def __init__(
        self,
        world: World,
        chain: TopChain,
        robot: Robot,
        names: Sequence[tuple[str, ...]],
        models: Mapping[str, Any],
    ) -> None:
        self._world, self._models = world, models
        self._robot, self._names, self._calls = robot, names, chain.calls
        self._states: list[Mapping[str, float]] = []
        bounded = _may_bound(chain, names)  # most chains have no regions: this is much faster
        for call in chain.calls if bounded else ():
            self._states.append(state_of(world, robot))
            world = projected(world, call, robot)
        self._bounds = [
            self._bounds_of(index) if bounded else [] for index in range(len(chain.calls))
        ]

    def allowing(self) -> Allowed | None:
        """Return the predicate for candidates of the chain's subgoals.

        None if nothing limits them.
        """
        return self.allowed if any(self._bounds) else None

    def of_subgoal(self, chain: TopChain, index: int, names: tuple[str, ...]) -> Allowed | None:
        """Return the predicate for candidates of one subgoal, if only `names` of it are searched.

        The subgoals before it are fixed as in `chain`; those after it keep their free variables.
        """
        free = [*[()] * index, names, *self._names[index + 1 :]]
        regions = Regions(self._world, chain, self._robot, free, self._models)
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
        self, rule: _Rule, index: int, after: Mapping[str, Any], own: Mapping[str, Any]
    ) -> Any:
        state = self._states[index] if rule.before else after
        margin = rule.bound.clearance(state, own if rule.goal is None else rule.goal)
        return math.inf if margin is None else margin

    def _bounds_of(self, index: int) -> list[_Rule]:
        """Return the bounds that the free variables of a subgoal decide on."""
        if not self._names[index]:
            return []
        rules = list(self._rules(index))
        # A bound that does not depend on the candidates cannot limit them.
        probe = np.stack([np.zeros(len(self._names[index])), np.ones(len(self._names[index]))])
        after, own = self._after(index, probe)
        return [rule for rule in rules if np.ndim(self._clearance(rule, index, after, own)) > 0]

    def _rules(self, index: int) -> Iterator[_Rule]:
        """Yield the bounds by the step that leads to a subgoal, and by the step that starts at it."""
        call = self._calls[index]
        step = f"of step {index + 1} ({call.top.name})"
        yield from (_Rule(f"post-condition {step}", bound) for bound in _bounds_in(call.top.post))
        if not (index and _PLACE & set(self._names[index - 1])):  # else the start is not known yet
            for bound in _bounds_in(call.top.pre):
                yield _Rule(f"pre-condition {step}", bound, before=True)
            distances = experience_of(self._models.get(call.top.action)).get("way")
            if distances is not None:
                bound = Distance(
                    "hold" if call.goal.point is Point.HOLD else "robot", "goal", *distances
                )
                yield _Rule(f"experience of {call.top.action}", bound, before=True)
        if index + 1 == len(self._calls):
            return
        following = self._calls[index + 1]
        source = f"pre-condition of step {index + 2} ({following.top.name})"
        room, goal = call.top.place_tolerance, goal_values(following.goal)
        free = _PLACE & set(self._names[index + 1])
        for bound in _bounds_in(following.top.pre):
            if isinstance(bound, Region):
                is_place = bound.variable.endswith((".x", ".y"))
                yield _Rule(source, bound, room if is_place else 0.0, goal)
            elif not (free and "goal" in bound.places):
                yield _Rule(source, bound, room, goal)

    def _after(self, index: int, values: FloatArray) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return state and goal variables after a step whose goal has these free values (n, k)."""
        call, post = self._calls[index], self._calls[index].top.post
        goal: dict[str, Any] = dict(goal_values(call.goal))
        for name, column in zip(self._names[index], values.T, strict=True):
            goal[name] = column if len(values) > 1 else float(column[0])
        arrival: dict[str, Any] = {}
        if call.top.arrives:
            there = columns_after(goal, call.goal.point, self._robot)
            arrival = {f"robot.{name}": value for name, value in there.items()}
            at_goal = call.goal.point is Point.HOLD  # whatever the heading
            arrival |= (
                {"hold.x": goal["x"], "hold.y": goal["y"]} if at_goal else self._hold(arrival)
            )
        state = post.apply({**self._states[index], **arrival}, goal) | arrival
        if not call.top.arrives and any(term.variable.startswith("robot.") for term in post.terms):
            state |= self._hold(state)
        return state, goal

    def _hold(self, state: Mapping[str, Any]) -> dict[str, Any]:
        yaw, hold = state["robot.yaw"], self._robot.hold
        ahead = {"hold.x": hold * np.cos(yaw), "hold.y": hold * np.sin(yaw)}
        places = {name: state[f"robot.{name[-1]}"] + offset for name, offset in ahead.items()}
        return places if self._robot.holder is not None else {}


def _may_bound(chain: TopChain, names: Sequence[tuple[str, ...]]) -> bool:
    """Return whether anything may bound a subgoal's candidates: a free place, or a condition next to it."""
    pairs = zip(names, chain.calls, [*chain.calls[1:], None], strict=True)
    return any(
        _PLACE & set(free)
        or _bounds_in(call.top.pre)
        or _bounds_in(call.top.post)
        or (after is not None and _bounds_in(after.top.pre))
        for free, call, after in pairs
        if free
    )


def _bounds_in(condition: Condition) -> list[Bound]:
    ranges = [term for term in condition.terms if isinstance(term, Region) and term.bounds]
    return [*condition.relations, *ranges]


# Experience


def experience_of(model: Any) -> Mapping[str, tuple[float, float]]:
    """Return the ranges of the episodes that a performance model was trained on, as far as it has them."""
    ranges: Mapping[str, tuple[float, float]] = getattr(model, "experience", {})
    return ranges


def _outside_experience(
    world: World, chain: TopChain, models: Mapping[str, PredictsPerformance], robot: Robot
) -> tuple[list[str], set[int]]:
    """Return sentences about quantities outside the experience, and the steps whose distance is outside."""
    found, far, opened = list[str](), set[int](), frozenset[str]()
    situations = chain_situations(world, chain, robot, models)
    for step, (call, direct) in enumerate(zip(chain.calls, situations, strict=True)):
        known = experience_of(models.get(call.top.action))
        opens = frozenset(name for name in ("x", "y", "yaw", "speed") if call.opens(name))
        numbers = dict(zip(direct.names, direct.table[:, 0].tolist(), strict=True))
        quantities = []  # name, label, value and unit of those that no open variable changes
        if not {"x", "y"} & (opened | opens):
            ahead = robot.hold * numbers["hold"] if robot.holder is not None else 0.0
            hold = Pose(numbers["x"], numbers["y"], numbers["yaw"]).ahead(ahead)
            distance = math.hypot(numbers["xg"] - hold.x, numbers["yg"] - hold.y)
            quantities.append(("way", "distance", distance, "m"))
        if "yaw" not in opened | opens:
            turn = abs(wrap_angle(numbers["yawg"] - numbers["yaw"]))
            quantities.append(("turn", "turn", turn, "rad"))
        if "speed" not in opened:
            quantities.append(("v", "speed at the start", numbers["v"], "m/s"))
        if "speed" not in opens:
            quantities.append(("speedg", "arrival speed", numbers["speedg"], "m/s"))
        for name, label, value, unit in quantities:
            low, high = known.get(name, (-math.inf, math.inf))
            slack = _SLACK + (_ROOM * (high - low) if math.isfinite(high - low) else 0.0)
            if not low - slack <= value <= high + slack:
                found.append(
                    f"step {step + 1} ({call.top.name}): {label} {value:.1f} {unit} is outside the "
                    f"experience of {low:.1f} to {high:.1f} {unit}"
                )
                far |= {step} if name == "way" else set()
        opened = opens
    return found, far


def within_experience(
    analysis: Analysis,
    world: World,
    chain: TopChain,
    models: Mapping[str, PredictsPerformance],
    robot: Robot,
) -> Analysis:
    """Return `analysis` with the ranges narrowed to the goals that the models were trained on.

    A variable whose range lies outside the experience is not free. Neither is a variable next to a
    step whose distance lies outside, since its predictions are extrapolated. Distances, turns and
    speeds that no open variable changes are compared with those at the starts of the episodes.
    """
    outside, far = _outside_experience(world, chain, models, robot)
    free, not_free = [], list(analysis.not_free)
    for variable in analysis.free:
        steps = [step for step in (variable.subgoal, variable.subgoal + 1) if step in far]
        if steps:
            why = f"next to step {steps[0] + 1}, whose distance is outside the experience"
            not_free.append(NotFree(variable.subgoal, variable.name, why))
            continue
        narrowed = variable
        for low, high, description in _experience_bounds(variable, chain, models):
            if min(high, narrowed.domain.high) <= max(low, narrowed.domain.low):
                why = f"beyond the {description}"
                not_free.append(NotFree(variable.subgoal, variable.name, why))
                break
            narrowed = _narrowed(narrowed, low, high, (description,))
        else:
            free.append(narrowed)
    return Analysis(tuple(free), tuple(not_free), tuple(outside))


def _experience_bounds(
    variable: FreeVariable, chain: TopChain, models: Mapping[str, PredictsPerformance]
) -> Iterator[tuple[float, float, str]]:
    """Yield the bounds of a variable by experience: low, high and a description.

    A heading has none.
    """
    if variable.domain.periodic:
        return
    call, *following = chain.calls[variable.subgoal : variable.subgoal + 2]
    affected = [(call.top.action, direct_name(variable.name))]
    for after in following:
        # The place at which the next action starts does not count: only that relative to its goal
        # matters.
        starts = _start_variables(variable.name, call.goal.point) - {"x", "y", "yaw"}
        affected += [(after.top.action, direct) for direct in sorted(starts)]
    for action, direct in affected:
        known = experience_of(models.get(action))
        if direct in known:
            low, high = known[direct]
            yield low, high, f"experience of {action}: {direct} from {low:.2f} to {high:.2f}"
    for after in following if variable.name == "speed" else ():
        # From faster arrivals the next action cannot brake to its goal's speed. The distance to
        # brake is unknown if a place is free, or if the goals are for different points of the
        # robot.
        braking = experience_of(models.get(after.top.action)).get("braking")
        moved = any(step.opens(name) for step in (call, after) for name in ("x", "y"))
        if braking is None or moved or call.goal.point != after.goal.point:
            continue
        left = 0.0 if after.opens("speed") else after.goal.speed
        fastest = math.sqrt(left**2 + 2.0 * braking[1] * call.goal.pose.distance(after.goal.pose))
        yield (
            0.0,
            fastest,
            f"experience of {after.top.action}: braking at up to {braking[1]:.2f} m/s^2",
        )


def within_regions(analysis: Analysis, regions: Regions, chain: TopChain) -> Analysis:
    """Return `analysis` with the ranges narrowed to the candidates that the regions allow.

    If a region allows none, the variables of the subgoal are not free.
    """
    free: list[FreeVariable] = []
    not_free = list(analysis.not_free)
    for index in range(len(chain.calls)):
        variables = [variable for variable in analysis.free if variable.subgoal == index]
        limits = regions.limits(index)
        if not limits:
            free += variables
            continue
        low, high = np.array(
            [(variable.domain.low, variable.domain.high) for variable in variables]
        ).T
        points = low + (high - low) * spread_points(len(variables), 0, _POINTS)
        points = points[regions.allowed(index, points)]
        if not len(points):
            why = f"without an allowed value: {'; '.join(limits)}"
            not_free += [NotFree(index, variable.name, why) for variable in variables]
            continue
        for variable, column in zip(variables, points.T, strict=True):
            room = _ROOM * float(np.ptp(column))
            narrowed = variable
            if not variable.domain.periodic:
                narrowed = _narrowed(
                    variable, float(column.min()) - room, float(column.max()) + room, limits
                )
            free.append(narrowed)
    return dataclasses.replace(analysis, free=tuple(free), not_free=tuple(not_free))


def _narrowed(
    variable: FreeVariable, low: float, high: float, limits: tuple[str, ...]
) -> FreeVariable:
    """Return the variable with its range cut to `low` to `high`, unless the cut is negligible."""
    domain = variable.domain
    width = domain.high - domain.low
    low, high = max(low, domain.low), min(high, domain.high)
    cut = max(low - domain.low, domain.high - high)
    if cut <= NEGLIGIBLE * width or low >= high:
        return variable
    return dataclasses.replace(
        variable,
        domain=dataclasses.replace(domain, low=low, high=high),
        limits=variable.limits + limits,
    )


# Changes


def allowed_changes(
    plan: TopChain, refined: TopChain, robot: Robot, ranges: Ranges
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
    for step, (old, new) in enumerate(zip(plan.calls, refined.calls, strict=True)):
        if old.goal.values.keys() != new.goal.values.keys():
            where = f"step {step + 1} ({old.top.name})"
            raise InvalidChainError(f"{where}: expected the goal variables of the question")
        planned, values = goal_values(old.goal), goal_values(new.goal)
        values = {
            name: value
            for name, value in values.items()
            if not same_value(name, planned[name], value)
        }
        for name, value in values.items():
            where = f"{name} of step {step + 1} ({old.top.name})"
            allowed = ranges[name](robot, old.goal) if name in ranges else None
            if not old.opens(name):
                expected = f"{planned[name]:g} as planned"
            elif (step, name) in bound:
                expected = f"no change, it is {bound[step, name]}"
            elif allowed is None:
                expected = "no change, it has no range"
            elif allowed.contains(value):
                continue
            else:
                expected = f"a number from {allowed.low:g} to {allowed.high:g}"
            raise InvalidChainError(f"{where}: expected {expected}, got {value:g}")
        changes.append(values)
    return changes


def same_value(name: str, old: float, new: float) -> bool:
    """Return whether two values of a goal variable are the same, headings up to whole turns."""
    difference = new - old if math.isfinite(new) else math.inf
    return (
        abs(wrap_angle(difference) if name == "yaw" and difference < math.inf else difference)
        <= _SAME
    )
