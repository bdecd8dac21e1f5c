"""What bounds the free variables of a chain beyond their ranges: the regions of conditions, and experience.

A performance model knows what was tried. Where its starts and goals end well inside a range, what lies beyond
is not searched.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ator_ros.actions.goal_variables import direct_name
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.refinement.free_variables import (
    Analysis,
    Cause,
    FreeVariable,
    NotFree,
    PredictsPerformance,
    start_variables,
)
from ator_ros.refinement.projection import chain_situations
from ator_ros.refinement.regions import Regions, experience_of
from ator_ros.refinement.sampled import spread_points
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.ranges import Range
from ator_ros.world.state import World

NEGLIGIBLE = 0.02
"""Share of a range that a bound must take away to count: random starts never reach the ends of theirs."""
_POINTS = 2048
_SLACK = 0.05
"""By how much (m, rad, m/s) a value may leave the experience, besides the share `_ROOM` of its range."""
_ROOM = 0.05
"""Share by which the extent of the points that a region allows is widened on each side."""
_LABELS = {"dist": "distance", "turn": "turn", "v": "speed at the start", "speedg": "arrival speed"}


class Outside(NamedTuple):
    """A quantity of a step that lies outside the experience of its performance model.

    Attributes
    ----------
    step : int
        Counted from 0.
    name : str
        Quantity: `dist`, `turn`, `v` or `speedg`.
    text : str
        A sentence that names the step, the value and the range.
    """

    step: int
    name: str
    text: str


def outside_experience(
    world: World, chain: TopChain, models: Mapping[str, PredictsPerformance], robot: Robot
) -> list[Outside]:
    """Return the quantities of a chain that lie outside the experience of the models, step by step.

    Distances, turns and speeds are compared with those at the starts of the episodes that a model was learned
    from. Variables that a step, or the one before it, leaves open are left out.
    """
    found, opened = [], frozenset[str]()
    situations = chain_situations(world, chain, robot)
    for step, (call, direct) in enumerate(zip(chain.calls, situations, strict=True)):
        known = experience_of(models.get(call.top.action))
        opens = frozenset(name for name in ("x", "y", "yaw", "speed") if call.opens(name))
        values = _quantities({name: float(row[0]) for name, row in direct.items()}, robot, opened, opens)
        for name, value, unit in values:
            low, high = known.get("way" if name == "dist" else name, (-math.inf, math.inf))
            slack = _SLACK + (_ROOM * (high - low) if math.isfinite(high - low) else 0.0)
            if not low - slack <= value <= high + slack:
                text = (
                    f"step {step + 1} ({call.top.name}): {_LABELS[name]} {value:.1f} {unit} is outside the "
                    f"experience of {low:.1f} to {high:.1f} {unit}"
                )
                found.append(Outside(step, name, text))
        opened = opens
    return found


def _quantities(
    direct: Mapping[str, float], robot: Robot, opened: frozenset[str], opens: frozenset[str]
) -> Iterator[tuple[str, float, str]]:
    """Yield name, value and unit of the quantities of a step that no open variable changes."""
    x, y, yaw = direct["x"], direct["y"], direct["yaw"]
    if not {"x", "y"} & (opened | opens):
        ahead = robot.hold * direct["hold"] if robot.holder is not None else 0.0
        hold = Pose(x, y, yaw).ahead(ahead)
        yield "dist", math.hypot(direct["xg"] - hold.x, direct["yg"] - hold.y), "m"
    if "yaw" not in opened | opens:
        yield "turn", abs(wrap_angle(direct["yawg"] - yaw)), "rad"
    if "speed" not in opened:
        yield "v", direct["v"], "m/s"
    if "speed" not in opens:
        yield "speedg", direct["speedg"], "m/s"


def within_experience(
    analysis: Analysis,
    chain: TopChain,
    models: Mapping[str, PredictsPerformance],
    outside: Sequence[Outside] = (),
) -> Analysis:
    """Return `analysis` with the ranges narrowed to the goals that the models were learned with.

    A variable of which they know no two values within its range is not free, and none is next to a step whose
    distance lies outside: its predictions are extrapolated.
    """
    free, not_free = [], list(analysis.not_free)
    far = {each.step: each for each in outside if each.name == "dist"}
    for variable in analysis.free:
        beyond = far.get(variable.subgoal, far.get(variable.subgoal + 1))
        if beyond is not None:
            why = f"next to step {beyond.step + 1}, whose distance is outside the experience"
            not_free.append(NotFree(variable.subgoal, variable.name, why, Cause.NO_EXPERIENCE))
            continue
        narrowed = variable
        for low, high, said in _experienced(variable, chain, models):
            if narrowed.domain.periodic:
                continue
            if min(high, narrowed.domain.high) <= max(low, narrowed.domain.low):
                why = f"beyond the {said}"
                not_free.append(NotFree(variable.subgoal, variable.name, why, Cause.NO_EXPERIENCE))
                break
            narrowed = _narrowed(narrowed, low, high, (said,))
        else:
            free.append(narrowed)
    return Analysis(tuple(free), tuple(not_free), tuple(each.text for each in outside))


def _experienced(
    variable: FreeVariable, chain: TopChain, models: Mapping[str, PredictsPerformance]
) -> Iterator[tuple[float, float, str]]:
    """Yield the bounds that experience sets to a variable, each with what it is."""
    for action, direct in _known_as(variable, chain):
        known = experience_of(models.get(action))
        if direct in known:
            low, high = known[direct]
            yield low, high, f"experience of {action}: {direct} from {low:.2f} to {high:.2f}"
    if variable.name == "speed" and variable.subgoal + 1 < len(chain.calls):
        yield from _braked(chain.calls[variable.subgoal], chain.calls[variable.subgoal + 1], models)


def _braked(
    call: TopCall, following: TopCall, models: Mapping[str, PredictsPerformance]
) -> Iterator[tuple[float, float, str]]:
    """Yield the arrival speeds from which the next action is known to come to its goal's in time.

    Where a place is free, or both are meant for different points of the robot, the way is not known.
    """
    known = experience_of(models.get(following.top.action)).get("braking")
    moved = any(step.opens(name) for step in (call, following) for name in ("x", "y"))
    if known is None or moved or call.goal.point != following.goal.point:
        return
    way = call.goal.pose.distance(following.goal.pose)
    left = 0.0 if following.opens("speed") else following.goal.speed
    said = f"experience of {following.top.action}: braking at up to {known[1]:.2f} m/s^2"
    yield 0.0, math.sqrt(left**2 + 2.0 * known[1] * way), said


def _known_as(variable: FreeVariable, chain: TopChain) -> Iterator[tuple[str, str]]:
    """Yield the actions that a variable matters to, and the direct variable that it is to each.

    Of where the next action starts, places are left out: those of its goals say as much.
    """
    call = chain.calls[variable.subgoal]
    yield call.top.action, direct_name(variable.name)
    if variable.subgoal + 1 < len(chain.calls):
        following = chain.calls[variable.subgoal + 1].top.action
        for direct in sorted(start_variables(variable.name, call.goal.point) - {"x", "y", "yaw"}):
            yield following, direct


def within_regions(analysis: Analysis, regions: Regions, chain: TopChain) -> Analysis:
    """Return `analysis` with the ranges narrowed to where regions have candidates.

    Where a region allows none, the variables of the subgoal are not free.
    """
    free: list[FreeVariable] = []
    not_free = list(analysis.not_free)
    for index in range(len(chain.calls)):
        variables = [variable for variable in analysis.free if variable.subgoal == index]
        if not variables or not regions.bounds(index):
            free += variables
            continue
        limits = regions.limits(index)
        points = _points([variable.domain for variable in variables])
        points = points[regions.allowed(index, points)]
        if not len(points):
            why = f"without an allowed value: {'; '.join(limits)}"
            not_free += [NotFree(index, variable.name, why, Cause.REGION) for variable in variables]
            continue
        for variable, column in zip(variables, points.T, strict=True):
            room = _ROOM * float(np.ptp(column))
            narrowed = variable
            if not variable.domain.periodic:
                narrowed = _narrowed(variable, float(column.min()) - room, float(column.max()) + room, limits)
            free.append(narrowed)
    return dataclasses.replace(analysis, free=tuple(free), not_free=tuple(not_free))


def _points(domains: Sequence[Range]) -> np.ndarray:
    low = np.array([domain.low for domain in domains])
    high = np.array([domain.high for domain in domains])
    return np.asarray(low + (high - low) * spread_points(len(domains), 0, _POINTS))


def _narrowed(variable: FreeVariable, low: float, high: float, limits: tuple[str, ...]) -> FreeVariable:
    """Return the variable with its range cut to `low` to `high`, if that takes away what counts."""
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
