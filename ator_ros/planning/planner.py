"""Chains for a goal, from the conditions of the TOPs in a library.

Goal variables that the plan does not determine are open; refinement replaces their preliminary
values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import with_values
from ator_ros.execution.fence import Fence
from ator_ros.geometry import FloatArray
from ator_ros.planning.facts import Fact, placed_thing, resolved
from ator_ros.planning.goals import GoalStatement, PlanningError, check_goal
from ator_ros.planning.problem import (
    PlannedStep,
    PlanningProblem,
    facts_of,
    planning_problem,
    steps_for,
)
from ator_ros.refinement.refiner import LONGEST_ALTERNATIVE, LONGEST_CHAIN, MOST_ALTERNATIVES
from ator_ros.tops.chain import Top, TopCall, TopChain, projected
from ator_ros.tops.conditions import State, state_of, state_variables
from ator_ros.tops.library import TopLibrary
from ator_ros.tops.objects import missing_object
from ator_ros.tops.ranges import USUAL_RANGES
from ator_ros.world.state import World

_MOST_PLANS = 16  # symbolic plans that are searched; for some of them there is no place for a step
_SPACING = 0.1  # m between candidate places
_MOST_INTERVALS = 400  # between candidate places along a side of the area, with a larger spacing
_LEAST_DISTANCE = 0.5  # m: preferred least distance of a place from the present one


def chains_for(
    goal: Sequence[GoalStatement],
    world: World,
    library: TopLibrary,
    objects: Sequence[str],
    fence: Fence | None = None,
) -> list[TopChain]:
    """Return the chains that achieve a goal, the shortest first.

    There are at most as many as a request to refinement may have, and none if the goal holds
    already.

    Parameters
    ----------
    goal : sequence
        Statements that must hold at the end.
    world : World
        State at the start.
    library : TopLibrary
        TOPs of the chains.
    objects : sequence of str
        Names of the objects of the domain.
    fence : Fence, optional
        Bounds of the chains; by default around the scene's area.

    Raises
    ------
    PlanningError
        The goal cannot be used, or there is no plan inside the fence. The message names the
        condition that no TOP achieves, or why no plan can be used.
    """
    robot = library.robot
    check_goal(goal, state_variables(objects, holder=robot.holder is not None))
    unfit = _unfit_tops(library, world)
    tops = [top for top in library.values() if top.name not in unfit]
    facts = facts_of(goal, tops)
    state = state_of(world, robot)
    if all(fact.violation(state) is None for fact in facts):
        return []
    problem = planning_problem(facts, steps_for(facts, tops), state)
    plans = problem.plans(_MOST_PLANS)
    if not plans:
        raise PlanningError("; ".join([*unfit.values(), _why_unreachable(problem)]))
    found: list[TopChain] = []
    reasons: list[str] = []
    for plan in plans:
        steps = [step for number in plan if (step := problem.steps[number])]
        try:
            chain = _valid_chain(
                steps,
                facts,
                world,
                library,
                fence or Fence.around(robot),
            )
            found.append(chain)
        except PlanningError as error:
            reasons.append(str(error))
    if not found:
        raise PlanningError("; ".join(dict.fromkeys(reasons)))
    first, *others = sorted(found, key=len)[: 1 + MOST_ALTERNATIVES]
    return [first, *(each for each in others if len(each) <= LONGEST_ALTERNATIVE)]


def _unfit_tops(library: TopLibrary, world: World) -> dict[str, str]:
    """Return why TOPs cannot be used, by name."""
    unfit: dict[str, str] = {}
    for top in library.values():
        if why := top.lacks(library.robot):
            unfit[top.name] = why
    for top in library.values():
        if top.name in unfit:
            continue
        if missing := missing_object(top, world):
            unfit[top.name] = f"{top.name} needs the {missing}, which is unknown"
    unfit |= library.left_out
    return unfit


def _valid_chain(
    steps: Sequence[PlannedStep],
    goal: Sequence[Fact],
    world: World,
    library: TopLibrary,
    fence: Fence,
) -> TopChain:
    """Return the chain of a plan; raise PlanningError if it is not valid in the situation."""
    robot = library.robot
    if len(steps) > LONGEST_CHAIN:
        raise PlanningError(f"plan of {len(steps)} steps: expected at most {LONGEST_CHAIN}")
    calls: list[TopCall] = []
    end = world
    for number, step in enumerate(steps, start=1):
        calls.append(
            _call(
                step,
                end,
                library,
                fence,
                last=number == len(steps),
            )
        )
        end = projected(end, calls[-1], robot)
    chain = TopChain(tuple(calls))
    if out := fence.violation(chain, robot):
        raise PlanningError(out)
    reasons = chain.violations(world, robot)
    state = state_of(end, robot)
    reasons += [f"at the end: {why}" for fact in goal if (why := fact.violation(state))]
    if reasons:
        raise PlanningError(f"plan {', '.join(step.top.name for step in steps)}: {reasons[0]}")
    return chain


def _why_unreachable(problem: PlanningProblem) -> str:
    """Return the conditions that no TOP achieves, or that no sequence of TOPs achieves at once."""
    met = problem.within_reach().union(*(operator.adds for operator in problem.operators))
    needed = dict.fromkeys(sorted(problem.goal), "")
    for number in problem.useful():
        if step := problem.steps[number]:
            for need in sorted(problem.operators[number].needs):
                needed.setdefault(need, f", which {step.top.name} needs")
    unmet = []
    for need, why in needed.items():
        if need not in met and need < len(problem.facts):
            unmet.append(f"no TOP achieves {problem.facts[need]}{why}")
    if unmet:
        return "; ".join(unmet)
    goal = " and ".join(str(problem.facts[number]) for number in sorted(problem.goal))
    return f"each condition can be achieved, but no sequence of TOPs ends with {goal}"


def _call(
    step: PlannedStep,
    world: World,
    library: TopLibrary,
    fence: Fence,
    *,
    last: bool,
) -> TopCall:
    robot = library.robot
    state = state_of(world, library.robot)
    known = resolved(dict(step.binding), state)
    goal = library.goal(step.top, world.robot.pose)
    at = world.robot.pose
    if step.top.point is Point.HOLD:
        at = robot.hold_point(at)
    place = {"x": known.get("x", at.x), "y": known.get("y", at.y)}
    if step.region:
        places = fence.narrowed({axis: USUAL_RANGES[axis] for axis in "xy"}, robot)
        along, across = (places[axis](robot, goal) for axis in "xy")
        edges = (along.low, across.low, along.high, across.high)
        found = _place_in(
            step.region,
            step.top,
            state,
            edges,
        )
        if found is None:
            raise PlanningError(f"{step.top.name}: expected a place for it in the area, found none")
        place = {"x": found[0], "y": found[1]}
    # The heading is toward the target of the next action, else along the approach.
    x = place["x"]
    y = place["y"]
    start_x, start_y, yaw = world.robot.pose
    target = dict(step.region[0].binding) if step.region else {}
    to_x = target.get("x")
    to_y = target.get("y")
    if isinstance(to_x, float) and isinstance(to_y, float) and (to_x, to_y) != (x, y):
        yaw = math.atan2(to_y - y, to_x - x)
    elif math.hypot(x - start_x, y - start_y) > 0.0:
        yaw = math.atan2(y - start_y, x - start_x)
    bound = frozenset() if step.region else frozenset(dict(step.binding))
    opened = set(goal.values)
    if step.top.arrives:
        opened |= {"x", "y", "yaw"}
        opened |= set() if last else {"speed"}
    values = {"yaw": yaw, **known, **place}
    return TopCall(
        step.top,
        with_values(goal, values),
        frozenset(opened) - bound,
    )


def _place_in(
    region: Sequence[Fact],
    top: Top,
    state: State,
    edges: tuple[float, float, float, float],
) -> tuple[float, float] | None:
    """Return the place (m) in a region and in `edges` that is nearest to the thing's present place.

    If possible it keeps the tolerance of the TOP that brings the thing there from the edge of the
    region.
    """
    thing = placed_thing(region[0].clause)
    places = _candidates(edges, resolved(dict(region[0].binding), state))
    there = {**state, f"{thing}.x": places[:, 0], f"{thing}.y": places[:, 1]}
    margins = []
    for fact in region:
        margin = fact.clause.clearance(there, resolved(dict(fact.binding), state))
        margins.append(-np.inf if margin is None else margin)
    least = np.min(margins, axis=0)
    for margin in (top.place_tolerance, 0.0):
        good = places[np.broadcast_to(least >= margin - 1e-9, len(places))]
        if len(good):
            present = [state[f"{thing}.{axis}"] for axis in "xy"]
            away = np.hypot(*(good - present).T)
            far = away >= _LEAST_DISTANCE
            if far.any():
                index = int(np.argmin(np.where(far, away, np.inf)))
            else:
                index = int(np.argmax(away))
            return float(good[index, 0]), float(good[index, 1])
    return None


def _candidates(edges: tuple[float, float, float, float], goal: Mapping[str, float]) -> FloatArray:
    """Return a grid of places inside the edges x_min, y_min, x_max, y_max, and the goal.

    Places are in m, shape (n, 2).
    """
    x_min, y_min, x_max, y_max = edges
    spacing = max(
        _SPACING,
        (x_max - x_min) / _MOST_INTERVALS,
        (y_max - y_min) / _MOST_INTERVALS,
    )
    xs = np.arange(x_min, x_max + spacing / 2, spacing)
    ys = np.arange(y_min, y_max + spacing / 2, spacing)
    grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    place_of_goal = [goal.get("x", 0.0), goal.get("y", 0.0)]
    return np.vstack([grid, place_of_goal])
