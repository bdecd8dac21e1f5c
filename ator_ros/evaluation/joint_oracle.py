"""Search all open headings jointly with dynamic programming over executed legs.

It is the oracle of chains whose robot stands between two actions. There the duration of an action depends
only on the poses at its two ends. So each leg is executed once for each pair of headings at its ends. The
best headings of the whole chain follow from these times. Then the chain with them is executed as a whole;
only this duration counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ator_ros.evaluation.policies import Toolset
from ator_ros.evaluation.trials import Trial, with_headings
from ator_ros.geometry import BoolArray, FloatArray, wrap_angle, wrap_angles
from ator_ros.refinement.chain_prediction import ChainModel
from ator_ros.refinement.free_variables import FreeVariable, names_of
from ator_ros.refinement.objective import Objective
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.ranges import USUAL_RANGES
from ator_ros.world.state import RobotState, World


@dataclass(frozen=True, slots=True)
class Tried:
    """A chain that was executed, and the durations in s of its actions; fewer where it failed."""

    chain: TopChain
    actions: tuple[float, ...] = ()


Drive = Callable[[World, TopChain], float]
"""Executes a chain of one action from rest; returns its duration in s, infinite where it fails."""
_SAME = 1e-3  # rad


def candidates(trial: Trial, chains: Sequence[TopChain], count: int) -> list[FloatArray]:
    """Return the headings (rad) to try at each step, shape (k,): of a closed one its own.

    Parameters
    ----------
    trial : Trial
        Whose chain says what is open.
    chains : sequence of TopChain
        What policies have chosen: their headings are tried too.
    count : int
        Number of evenly spaced headings.
    """
    offered = []
    for index, call in enumerate(trial.chain.calls):
        if "yaw" not in call.open:
            offered.append(np.array([call.goal.pose.yaw]))
            continue
        chosen = [wrap_angle(chain.calls[index].goal.pose.yaw) for chain in chains]
        even = [wrap_angle(2.0 * math.pi * k / count) for k in range(count)]
        distinct: list[float] = []
        for yaw in (*chosen, *even):
            if all(abs(wrap_angle(yaw - other)) > _SAME for other in distinct):
                distinct.append(yaw)
        offered.append(np.array(distinct))
    return offered


def predicted_legs(tools: Toolset, trial: Trial, offered: Sequence[FloatArray]) -> list[FloatArray]:
    """Return what the learned models predict for each leg, shape (headings before, headings after), in s."""
    calls = trial.chain.calls
    free = [
        FreeVariable(index, "yaw", USUAL_RANGES["yaw"](tools.robot, call.goal))
        for index, call in enumerate(calls)
    ]
    models = tools.models["learned"]
    names = names_of(trial.chain, free)
    model = ChainModel(
        trial.world, trial.chain, tools.robot, models=models, names=names, objective=Objective()
    )
    legs = []
    for index, after in enumerate(offered):
        before = offered[index - 1] if index else np.zeros(1)
        pairs = np.stack(np.meshgrid(before, after, indexing="ij"), axis=-1).reshape(-1, 2)
        start = pairs[:, :1] if index else np.zeros((len(pairs), 0))
        cost = model.step_cost(index, start, pairs[:, 1:])
        legs.append(np.broadcast_to(cost, len(pairs)).reshape(len(before), len(after)))
    return legs


def promising(legs: Sequence[FloatArray], margin: float | None) -> list[BoolArray]:
    """Return of each leg which pairs lie on a chain predicted to take at most `margin` s above the least."""
    forward = [np.zeros(1)]
    for leg in legs:
        forward.append(np.min(forward[-1][:, None] + leg, axis=0))
    backward = [np.zeros(legs[-1].shape[1])]
    for leg in reversed(legs):
        backward.insert(0, np.min(leg + backward[0][None, :], axis=1))
    bound = math.inf if margin is None else float(np.min(forward[-1])) + margin + 1e-9
    ways = zip(forward, legs, backward[1:], strict=False)
    return [before[:, None] + leg + after[None, :] <= bound for before, leg, after in ways]


def least(legs: Sequence[FloatArray]) -> list[int]:
    """Return the numbers of the headings, one a step, of the chain whose legs take least."""
    sums, origins = np.zeros(1), []
    for leg in legs:
        ways = sums[:, None] + leg
        origins.append(np.argmin(ways, axis=0))
        sums = ways.min(axis=0)
    path = [int(np.argmin(sums))]
    for origin in reversed(origins[1:]):
        path.insert(0, int(origin[path[0]]))
    return path


def best_headings(
    tools: Toolset,
    trial: Trial,
    tried: Iterable[Tried],
    drive: Drive,
    *,
    count: int,
    margin: float | None,
) -> tuple[TopChain, int]:
    """Return the chain with the headings that take least by executed legs, and how many were executed.

    Parameters
    ----------
    tools : Toolset
        Of the learned models, which say what is not worth executing.
    trial : Trial
        The situation.
    tried : iterable of Tried
        What policies have chosen and executed: their headings are offered, their legs are not executed again.
    drive : callable
        Executes a leg.
    count, margin
        Headings at each open step, and what is left out (see `promising`); None: nothing.
    """
    runs = list(tried)
    offered = candidates(trial, [run.chain for run in runs], count)
    wanted = promising(predicted_legs(tools, trial, offered), margin)
    poses = [trial.world.robot.pose, *(call.goal.pose for call in trial.chain.calls)]
    legs, executed = [], 0
    for index, (here, _) in enumerate(pairwise(poses)):
        before = offered[index - 1] if index else np.array([here.yaw])
        times = np.full((len(before), len(offered[index])), math.nan)
        for run in runs:
            if len(run.actions) == len(trial.chain.calls):
                row = _number(before, run.chain.calls[index - 1].goal.pose.yaw) if index else 0
                column = _number(offered[index], run.chain.calls[index].goal.pose.yaw)
                times[row, column] = run.actions[index]
        for row, column in np.argwhere(wanted[index] & np.isnan(times)):
            start = RobotState(here._replace(yaw=float(before[row])))
            call = _at(trial.chain.calls[index], float(offered[index][column]))
            times[row, column] = drive(World(0.0, start, trial.world.objects), TopChain((call,)))
            executed += 1
        legs.append(np.where(np.isnan(times), math.inf, times))
    path = least(legs)
    opened = {i: float(offered[i][n]) for i, n in enumerate(path) if "yaw" in trial.chain.calls[i].open}
    return with_headings(trial.chain, opened), executed


def _number(headings: FloatArray, yaw: float) -> int:
    """Return which of the headings is `yaw`."""
    return int(np.argmin(np.abs(wrap_angles(headings - yaw))))


def _at(call: TopCall, yaw: float) -> TopCall:
    return with_headings(TopChain((call,)), {0: yaw}).calls[0]
