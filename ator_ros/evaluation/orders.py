"""Orders of a round that are chosen by lengths, as is usual without models of the drives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ator_ros.bases.description import Robot
from ator_ros.bases.routes import routes_of
from ator_ros.domains.trials import Trial
from ator_ros.geometry import FloatArray
from ator_ros.refinement.order_search import best_orders
from ator_ros.tops.chain import TopChain
from ator_ros.tops.ordering import Ordering, ordering_of

Lengths = Callable[[Robot, FloatArray, FloatArray], FloatArray]
"""Returns the lengths in m, shape (m,), of the ways between m pairs of places, shapes (2, m)."""
OrderChoice = Callable[[FloatArray, Ordering], list[int]]
"""Returns an order from the lengths of legs, see `best_orders`, with one candidate of each call."""


def straight(robot: Robot, starts: FloatArray, ends: FloatArray) -> FloatArray:  # noqa: ARG001
    """Return the lengths of straight lines."""
    lengths: FloatArray = np.hypot(*(ends - starts))
    return lengths


def along_routes(robot: Robot, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Return the lengths of routes on the robot's map; without one, of straight lines."""
    routes = routes_of(robot)
    if routes is None:
        return straight(robot, starts, ends)
    pairs = np.concatenate((starts, ends)).T
    return np.array([routes.between(*pair[:, None]).length[0] for pair in pairs])


def shortest(costs: FloatArray, ordering: Ordering) -> list[int]:
    """Return the order of the least sum."""
    return list(best_orders(costs, ordering, None, 1)[0].order)


def ordered(
    robot: Robot,
    trial: Trial,
    choose: OrderChoice,
    lengths: Lengths,
) -> TopChain:
    """Return a trial's chain in the order that lengths determine; its calls keep their places.

    Parameters
    ----------
    robot : Robot
        Its map has the routes.
    trial : Trial
        A chain of calls that all arrive at their goals.
    choose : callable
        `shortest`, or `nearest_next`.
    lengths : callable
        `straight` or `along_routes`.
    """
    calls = trial.chain.calls
    goals = np.array([call.goal.robot_pose(robot)[:2] for call in calls])
    places = np.vstack((trial.world.robot.pose[:2], goals))
    count = len(calls)
    starts = np.repeat(places, count, axis=0).T
    ends = np.tile(goals, (count + 1, 1)).T
    costs = lengths(robot, starts, ends).reshape(count + 1, 1, count, 1)
    return trial.chain.reordered(choose(costs, ordering_of(trial.chain))).part(0)
