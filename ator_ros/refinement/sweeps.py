"""The search around a chain that is nearly the best: one subgoal after the other, its neighbours held.

A grid through all subgoals has found which chain is best as a whole. What is left is to place each subgoal
exactly, which changes little for its neighbours. So each subgoal in turn moves to the best candidate of a
window around it, and again in narrower windows (coordinate descent). Two predictions of a few candidates tell
the cost of a whole window, where all pairs of two windows would take thousands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ator_ros.geometry import FloatArray
from ator_ros.refinement.averaging import Averages, averaged
from ator_ros.refinement.paths import BestPath, StepCost
from ator_ros.refinement.slices import Slices

Windows = Callable[[int, FloatArray, int], FloatArray]
"""Returns candidates (n, k) of subgoal i, the first its value (k,), in a round counted from 0."""


def sweeping(
    step_cost: StepCost, path: BestPath, windows: Windows, rounds: int, averages: Averages | None = None
) -> Slices[tuple[list[FloatArray], float, bool]]:
    """Move the subgoals of a path in turn, from the first to the last, `rounds` times.

    Parameters
    ----------
    step_cost : callable
        See `ator_ros.refinement.paths.StepCost`.
    path : BestPath
        The chain to begin with. Subgoals without free variables stay as they are.
    windows : callable
        The candidates of a subgoal.
    rounds : int
        How often.
    averages : Averages, optional
        As in `ator_ros.refinement.paths.least_path`.

    Returns
    -------
    tuple
        The values of each subgoal, the cost of the whole chain, and whether there was time for all rounds.
    """
    values, costs = list(path.values), list(path.costs)
    for number in range(rounds):
        for index in range(len(values)):
            if not len(values[index]):
                continue
            late = yield
            if late:
                return values, sum(costs), False
            candidates = windows(index, values[index], number)
            beside = yield from _costs_beside(step_cost, values, index, candidates, averages)
            best = int(np.argmin(sum(beside[1:], start=beside[0])))
            values[index] = candidates[best]
            costs[index : index + 2] = [float(cost[best]) for cost in beside]
    return values, sum(costs), True


def _costs_beside(
    step_cost: StepCost,
    values: Sequence[FloatArray],
    index: int,
    candidates: FloatArray,
    averages: Averages | None,
) -> Slices[list[FloatArray]]:
    """Return the costs, shapes (n,), of the step to a subgoal and of the one after it, if there is one."""
    weights = averages.weights(index, candidates) if averages is not None else None
    before = values[index - 1][None, :] if index else np.zeros((1, 0))
    leading = np.broadcast_to(step_cost(index, before, candidates), len(candidates))
    leading = averaged(leading[None, :], None, weights)[0] if averages is not None else leading
    if index + 1 == len(values):
        return [leading]
    yield
    following = np.broadcast_to(step_cost(index + 1, candidates, values[index + 1][None, :]), len(candidates))
    following = averaged(following[:, None], weights, None)[:, 0] if averages is not None else following
    return [leading, following]
