"""Room ahead of an arrival at speed, of which the models know nothing.

Features of models tell where a goal lies from the robot, not where walls stand. A robot that arrives at a
bay at a speed from which it can neither turn nor stop gets stuck inside, or beside its wall. So candidates
whose way to stop leads through a bay, or nearer to it than the robot needs to turn, are left out, where the
gate's file asks for it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import goal_values
from ator_ros.geometry import BoolArray, FloatArray
from ator_ros.refinement.paths import StepCost
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain

_STEP = 0.1  # m between the points that are looked at: less than the depth of a bay
_MOST_POINTS = 400
_ASIDE = (-1.0, 0.0, 1.0)
_CLEARANCE = 0.1  # m: a wall is some centimetres thick, and no robot comes exactly where it should


def with_room(
    step_cost: StepCost, chain: TopChain, names: Sequence[tuple[str, ...]], robot: Robot, room: float
) -> StepCost:
    """Return `step_cost`, infinite for arrivals at a free speed that leave no room to stop.

    What `chain` itself asks for keeps its cost.

    Parameters
    ----------
    step_cost : callable
        Costs of the steps of `chain`.
    chain, names, robot
        What is refined, and the free variables of each subgoal.
    room : float
        Multiple of the way to stop that must be free; 0: none.
    """
    if room <= 0.0:
        return step_cost

    def cost(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        costs = step_cost(index, before, after)
        if "speed" not in names[index]:
            return costs
        goal = chain.calls[index].goal
        given = (after == [goal_values(goal)[name] for name in names[index]]).all(axis=1)
        return np.where(given | leaves_room(goal, names[index], after, robot, room), costs, np.inf)

    return cost


def leaves_room(
    goal: Goal, names: tuple[str, ...], candidates: FloatArray, robot: Robot, room: float
) -> BoolArray:
    """Return which arrivals leave room to stop straight ahead, `room` times the way, and to turn: shape (n,).

    `names` are the variables of the columns of `candidates`, (n, k); `goal` has the values of the others.
    """
    value = {**goal_values(goal), **dict(zip(names, candidates.T, strict=True))}
    held = robot.holder if goal.point is Point.HOLD else None
    brake = robot.limits.brake if held is None else min(held.limits.brake, robot.limits.brake)
    speed = np.broadcast_to(np.asarray(value["speed"], dtype=float), len(candidates))
    way = room * speed * speed / (2.0 * brake)
    ahead = way + (held.radius if held is not None else robot.front)
    points = min(int(np.max(ahead, initial=0.0) / _STEP) + 2, _MOST_POINTS)
    along = np.linspace(0.0, 1.0, points)[:, None, None] * ahead
    aside = np.array(_ASIDE)[:, None] * (robot.reach + _CLEARANCE)  # room to turn, too
    cos, sin = np.cos(value["yaw"]), np.sin(value["yaw"])
    x, y = value["x"] + along * cos - aside * sin, value["y"] + along * sin + aside * cos
    free = np.ones(len(candidates), dtype=bool)
    for bay in robot.scene.bays:
        c, s = np.cos(bay.yaw), np.sin(bay.yaw)
        deep, beside = c * (x - bay.x) + s * (y - bay.y), c * (y - bay.y) - s * (x - bay.x)
        inside = (deep > 0.0) & (deep < bay.depth) & (np.abs(beside) < bay.width / 2.0)
        free &= ~inside.any(axis=(0, 1))
    result: BoolArray = free | (speed <= 0.0)
    return result
