"""Evaluation of one situation.

Every policy chooses a chain, and each distinct chain is executed once. The oracle executes many
chains and chooses the best.

If the robot stands between two actions, the duration of an action depends only on the poses at its
two ends. Then the oracle can search all open headings jointly: each leg is executed for each pair
of headings at its ends, and dynamic programming finds the best chain. This chain is executed as a
whole, and only the duration of that execution counts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ator_ros.actions.base import Goal
from ator_ros.evaluation.chain_run import ChainRun, run_chain
from ator_ros.evaluation.policies import POLICIES, USUAL, Choice, naive
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.evaluation.trials import Trial, random_trial, with_headings
from ator_ros.geometry import FloatArray, Pose, wrap_angle
from ator_ros.performance.direct import YAW, X, Y
from ator_ros.refinement.chain_prediction import ChainModel
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.search import least_path
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import RobotState, World

Record = dict[str, Any]
"""The result of one situation; see `evaluate_trial`."""


@dataclass(frozen=True)
class Settings:
    """Everything that the result of an evaluation depends on.

    Attributes
    ----------
    seed : int
        Seed of the situations.
    chain : str
        Name of one of the domain's chains.
    policies : tuple of str
        Names of `POLICIES`.
    oracle : int
        Number of evenly spaced headings of the first subgoal that the oracle executes, starting
        with the naive one; 0: no oracle.
    oracle_margin : float or None
        Headings that are predicted to take this much longer than the best (s) are not executed;
        None: all are.
    oracle_speeds : tuple of float
        Arrival speeds in m/s that the oracle of heading and speed executes for each heading.
    source : ToolsetSource
        Robot, actions and models.
    joint_oracle : bool
        Whether the oracle searches all open headings jointly, by executing legs. This is for chains
        in which the robot stands between two actions.
    """

    seed: int
    chain: str
    policies: tuple[str, ...] = USUAL
    oracle: int = 0
    oracle_margin: float | None = None
    oracle_speeds: tuple[float, ...] = ()
    source: ToolsetSource = field(default_factory=ToolsetSource)
    joint_oracle: bool = False


class Executions:
    """Executes chains from one start. Equal chains are executed once.

    Attributes
    ----------
    runs : dict
        The results, by the goals of the chains.
    """

    def __init__(
        self,
        tools: Toolset,
        library: TopLibrary,
        trial: Trial,
    ) -> None:
        self._run = partial(
            run_chain,
            tools.robot,
            library,
            time_limit=tools.domain.time_limit,
        )
        self._start = trial.world
        self.runs: dict[tuple[Goal, ...], ChainRun] = {}

    def __call__(self, chain: TopChain) -> ChainRun:
        """Return the run of `chain`, which may differ only in its goals from those before."""
        goals = tuple(call.goal for call in chain.calls)
        if goals not in self.runs:
            self.runs[goals] = self._run(self._start, chain)
        return self.runs[goals]

    def leg(self, start: World, chain: TopChain) -> float:
        """Return the duration in s of a chain from another start; infinite if it fails."""
        run = self._run(start, chain)
        return run.duration if run.success else math.inf


def evaluate_trial(task: tuple[Settings, int]) -> Record:
    """Evaluate all policies in one situation.

    `task` are the settings and the number of the situation.

    Returns
    -------
    dict
        "index"; "start": robot x, y, yaw, first goal x, y, second goal x, y, yaw, if there is one
        (m, rad); "policies": by name "duration" (s), "success", "reason", "error" (m), "chosen":
        heading, speed and declared goal variables of each intermediate subgoal, "actions":
        durations of the actions (s), "predicted": duration of the chain (s), "gain" and
        "uncertainty": the input of the gate (s); "oracle": "headings" (rad), "durations" (s),
        "best" (s) and "success"; "oracle_speed": "best" and "success"; "executed": number of chains
        executed.
    """
    settings, index = task
    tools, library = tools_of(settings.source)
    trial = random_trial(
        tools.domain,
        settings.chain,
        library,
        seed=settings.seed,
        index=index,
    )
    execute = Executions(tools, library, trial)
    choices = {name: POLICIES[name](tools, trial) for name in settings.policies}
    policies = {}
    for name, choice in choices.items():
        policies[name] = _policy_record(choice, execute(choice.chain))
    record: Record = {"index": index, "start": _start(trial), "policies": policies}
    if settings.oracle and settings.joint_oracle:
        chosen = [choice.chain for choice in choices.values()]
        record.update(_joint_oracle(settings, tools, trial, execute, chosen))
    elif settings.oracle:
        start = naive(tools, trial).chain
        record.update(_oracle(settings, tools, trial, execute, start))
    record["executed"] = len(execute.runs)
    return record


def _start(trial: Trial) -> list[float]:
    first, *later = (call.goal.pose for call in trial.chain.calls)
    second = later[0] if later else ()
    places = (*trial.world.robot.pose, first.x, first.y, *second)
    return [round(value, 4) for value in places]


def _policy_record(choice: Choice, run: ChainRun) -> Record:
    record: Record = {
        "duration": round(run.duration, 3),
        "success": run.success,
        "chosen": [_chosen_values(call.goal) for call in choice.chain.calls[:-1]],
        "actions": [round(duration, 3) for duration in run.actions],
    }
    if not run.success:
        record["reason"] = run.reason
    elif not math.isnan(run.error):
        record["error"] = round(run.error, 4)
    if choice.predicted is not None:
        record["predicted"] = round(choice.predicted.duration, 3)
    if choice.refinement is not None and choice.refinement.free:
        found = choice.refinement
        record |= {"gain": round(found.gain, 5), "uncertainty": round(found.uncertainty, 5)}
    return record


def _chosen_values(goal: Goal) -> list[float]:
    declared = [round(value, 4) for value in goal.values.values()]
    return [round(goal.pose.yaw, 4), round(goal.speed, 3), *declared]


def _joint_oracle(
    settings: Settings,
    tools: Toolset,
    trial: Trial,
    execute: Executions,
    chosen: Sequence[TopChain],
) -> dict[str, Record]:
    """Execute the chain with the best headings by executed legs, and the chains of the policies."""
    chain, legs = best_headings(
        tools, trial, chosen, execute.leg, count=settings.oracle, margin=settings.oracle_margin
    )
    runs = [execute(each) for each in (chain, *chosen)]
    best = min(runs, key=lambda run: run.duration)
    headings = [round(call.goal.pose.yaw, 3) for call in chain.calls]
    return {"oracle": {"headings": headings, "durations": [None], **_best(best), "legs": legs}}


def _best(run: ChainRun) -> Record:
    return {"best": round(run.duration, 3), "success": run.success}


def _oracle(
    settings: Settings, tools: Toolset, trial: Trial, execute: Executions, start: TopChain
) -> dict[str, Record]:
    """Execute evenly spaced headings of the first subgoal, later ones as predicted best."""
    naive_heading = start.calls[0].goal.pose.yaw
    steps = (2.0 * math.pi * k / settings.oracle for k in range(settings.oracle))
    headings = [wrap_angle(naive_heading + step) for step in steps]
    chains = [with_headings(start, {0: yaw}) for yaw in headings]
    if len(start.calls) > 2:
        plans = [with_headings(trial.chain, {0: yaw}) for yaw in headings]
        chains = [tools.refiner().refine(trial.world, plan).chain for plan in plans]
    runs = _executed(settings, tools, trial, execute, chains)
    executed = [run for run in runs if run is not None]
    best = min([*executed, execute(start)], key=lambda run: run.duration)
    durations = [None if run is None else round(run.duration, 2) for run in runs]
    rounded = [round(yaw, 3) for yaw in headings]
    records = {"oracle": {"headings": rounded, "durations": durations, **_best(best)}}
    if settings.oracle_speeds:
        moving = []
        for chain in chains:
            for speed in settings.oracle_speeds:
                goal = dataclasses.replace(chain.calls[0].goal, speed=speed)
                moving.append(chain.with_goal(0, goal))
        runs = _executed(settings, tools, trial, execute, moving)
        moving_runs = [run for run in runs if run is not None]
        best_of_both = min([best, *moving_runs], key=lambda run: run.duration)
        records["oracle_speed"] = _best(best_of_both)
    return records


def _executed(
    settings: Settings,
    tools: Toolset,
    trial: Trial,
    execute: Executions,
    chains: Sequence[TopChain],
) -> list[ChainRun | None]:
    """Execute the chains whose predicted duration is within the oracle's margin of the least."""
    costs = [tools.predict(trial.world, chain).cost for chain in chains]
    margin = settings.oracle_margin
    bound = math.inf if margin is None else min(costs) + margin
    runs = []
    for chain, cost in zip(chains, costs, strict=True):
        runs.append(execute(chain) if cost <= bound else None)
    return runs


Drive = Callable[[World, TopChain], float]
"""Executes a chain of one action from rest; returns its duration in s, infinite where it fails."""
_SAME = 1e-3  # rad up to which headings are the same
_ROUNDING = 1e-9  # s


def candidates(
    trial: Trial,
    chains: Sequence[TopChain],
    count: int,
) -> list[FloatArray]:
    """Return the headings to try at each step of a trial's chain.

    Returns
    -------
    list of array of float, shape (k,)
        For each step, in rad: the headings of `chains`, and `count` evenly spaced ones; only the
        step's own heading if it is not open.
    """
    offered = []
    spaced = [2.0 * math.pi * k / count for k in range(count)]
    for index, call in enumerate(trial.chain.calls):
        distinct: list[float] = []
        if "yaw" in call.open:
            chosen = [chain.calls[index].goal.pose.yaw for chain in chains]
            for yaw in (*chosen, *spaced):
                if all(abs(wrap_angle(yaw - other)) > _SAME for other in distinct):
                    distinct.append(wrap_angle(yaw))
        offered.append(np.array(distinct or [call.goal.pose.yaw]))
    return offered


def best_headings(
    tools: Toolset,
    trial: Trial,
    chosen: Sequence[TopChain],
    drive: Drive,
    *,
    count: int,
    margin: float | None,
) -> tuple[TopChain, int]:
    """Find the chain that is fastest by executed legs.

    Parameters
    ----------
    tools : Toolset
        The models.
    trial : Trial
        The situation and its plan.
    chosen : sequence of TopChain
        The policies' choices, whose headings are tried too.
    drive : callable
        Executes a leg.
    count : int
        Number of evenly spaced headings that are tried at each open step.
    margin : float or None
        Headings are left out if the models predict that all chains through them take this much
        longer than the best (s); None: all are tried.

    Returns
    -------
    chain : TopChain
        The fastest chain.
    legs : int
        Number of executed legs.
    """
    calls = trial.chain.calls
    names = [("yaw",)] * len(trial.chain)
    model = ChainModel(
        trial.world,
        trial.chain,
        tools.robot,
        models=tools.models,
        names=names,
        objective=Objective(),
    )
    offered = [headings[:, None] for headings in candidates(trial, chosen, count)]
    predicted = least_path(model.step_costs, offered)
    bound = math.inf if margin is None else predicted.cost + margin + _ROUNDING
    promising = [curve.values[curve.totals <= bound] for curve in predicted.curves]
    executed = 0

    def duration(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        nonlocal executed
        starts = model.rows[index].values(before, after)[[X, Y, YAW]]
        headings = np.broadcast_to(after[:, 0], starts[0].shape)
        poses = [Pose(*start) for start in starts.reshape(3, -1).T.tolist()]
        worlds = [World(0.0, RobotState(pose), trial.world.objects) for pose in poses]
        leg = TopChain((calls[index],))
        legs = [with_headings(leg, {0: yaw}) for yaw in headings.ravel().tolist()]
        executed += len(legs)
        durations = [drive(*pair) for pair in zip(worlds, legs, strict=True)]
        return np.reshape(durations, headings.shape)

    values = least_path(lambda steps: [duration(*pairs) for pairs in steps], promising).values
    opened = {i: float(yaw[0]) for i, yaw in enumerate(values) if "yaw" in calls[i].open}
    return with_headings(trial.chain, opened), executed
