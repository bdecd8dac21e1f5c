"""Evaluation of one situation: every policy chooses a chain, and each distinct chain is executed once.

The oracle executes many chains and chooses the best. If the robot stands between two actions, the
duration of an action depends only on the poses at its two ends. Then the oracle can search all open
headings jointly: each leg is executed for each pair of headings at its ends, and dynamic
programming finds the best chain. This chain is executed as a whole, and only the duration of that
execution counts.
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
    """Everything that the result of an evaluation depends on."""

    seed: int  # of the situations
    chain: str  # name of one of the domain's chains
    policies: tuple[str, ...] = USUAL  # names of `POLICIES`
    oracle: int = 0
    """Number of evenly spaced headings of the first subgoal that the oracle executes, starting with the naive
    one; 0: no oracle."""
    oracle_margin: float | None = None
    """Headings that are predicted to take this much longer than the best (s) are not executed; None: all."""
    oracle_speeds: tuple[float, ...] = ()
    """Arrival speeds in m/s that the oracle of heading and speed executes for each heading."""
    source: ToolsetSource = field(default_factory=ToolsetSource)
    joint_oracle: bool = False
    """Whether the oracle searches all open headings jointly, by executing legs, for chains in which the robot
    stands between two actions."""


class Executions:
    """Executes chains from one start.

    Equal chains are executed once, and `runs` has the results.
    """

    def __init__(self, tools: Toolset, library: TopLibrary, trial: Trial) -> None:
        self._run = partial(run_chain, tools.robot, library, time_limit=tools.domain.time_limit)
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
    trial = random_trial(tools.domain, settings.chain, library, seed=settings.seed, index=index)
    execute = Executions(tools, library, trial)
    choices = {name: POLICIES[name](tools, trial) for name in settings.policies}
    record: Record = {
        "index": index,
        "start": _start(trial),
        "policies": {
            name: _policy_record(choice, execute(choice.chain)) for name, choice in choices.items()
        },
    }
    if settings.oracle and settings.joint_oracle:
        record.update(
            _joint_oracle(settings, tools, trial, execute, [c.chain for c in choices.values()])
        )
    elif settings.oracle:
        record.update(_oracle(settings, tools, trial, execute, naive(tools, trial).chain))
    record["executed"] = len(execute.runs)
    return record


def _start(trial: Trial) -> list[float]:
    first, *later = (call.goal.pose for call in trial.chain.calls)
    places = (*trial.world.robot.pose, first.x, first.y, *(later[0] if later else ()))
    return [round(value, 4) for value in places]


def _policy_record(choice: Choice, run: ChainRun) -> Record:
    record: Record = {
        "duration": round(run.duration, 3),
        "success": run.success,
        "chosen": [
            [
                round(goal.pose.yaw, 4),
                round(goal.speed, 3),
                *(round(v, 4) for v in goal.values.values()),
            ]
            for goal in (call.goal for call in choice.chain.calls[:-1])
        ],
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


def _joint_oracle(
    settings: Settings,
    tools: Toolset,
    trial: Trial,
    execute: Executions,
    chosen: Sequence[TopChain],
) -> dict[str, Record]:
    """Execute the chain with the best headings by executed legs.

    The chains of the policies count too.
    """
    chain, legs = best_headings(
        tools, trial, chosen, execute.leg, count=settings.oracle, margin=settings.oracle_margin
    )
    best = min([execute(each) for each in (chain, *chosen)], key=lambda run: run.duration)
    headings = [round(call.goal.pose.yaw, 3) for call in chain.calls]
    return {"oracle": {"headings": headings, "durations": [None], **_best(best), "legs": legs}}


def _best(run: ChainRun) -> Record:
    return {"best": round(run.duration, 3), "success": run.success}


def _oracle(
    settings: Settings, tools: Toolset, trial: Trial, execute: Executions, start: TopChain
) -> dict[str, Record]:
    """Execute evenly spaced headings of the first subgoal, each with the predicted best of later ones."""
    naive_heading = start.calls[0].goal.pose.yaw
    steps = (2.0 * math.pi * k / settings.oracle for k in range(settings.oracle))
    headings = [wrap_angle(naive_heading + step) for step in steps]
    chains = [with_headings(start, {0: yaw}) for yaw in headings]
    if len(start.calls) > 2:
        plans = [with_headings(trial.chain, {0: yaw}) for yaw in headings]
        chains = [tools.refiner().refine(trial.world, plan).chain for plan in plans]
    runs = _executed(settings, tools, trial, execute, chains)
    best = min(
        [run for run in runs if run is not None] + [execute(start)], key=lambda run: run.duration
    )
    durations = [None if run is None else round(run.duration, 2) for run in runs]
    rounded = [round(yaw, 3) for yaw in headings]
    records = {"oracle": {"headings": rounded, "durations": durations, **_best(best)}}
    if settings.oracle_speeds:
        moving = [
            chain.with_goal(0, dataclasses.replace(chain.calls[0].goal, speed=speed))
            for chain in chains
            for speed in settings.oracle_speeds
        ]
        moving_runs = [
            run for run in _executed(settings, tools, trial, execute, moving) if run is not None
        ]
        records["oracle_speed"] = _best(min([best, *moving_runs], key=lambda run: run.duration))
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
    return [
        execute(chain) if cost <= bound else None for chain, cost in zip(chains, costs, strict=True)
    ]


Drive = Callable[[World, TopChain], float]
"""Executes a chain of one action from rest; returns its duration in s, infinite where it fails."""
_SAME = 1e-3  # rad
_ROUNDING = 1e-9  # s


def candidates(trial: Trial, chains: Sequence[TopChain], count: int) -> list[FloatArray]:
    """Return the headings (rad) to try at each step, shape (k,): `count` ones, and those of `chains`."""
    offered = []
    for index, call in enumerate(trial.chain.calls):
        distinct: list[float] = []
        if "yaw" in call.open:
            chosen = [chain.calls[index].goal.pose.yaw for chain in chains]
            for yaw in (*chosen, *(2.0 * math.pi * k / count for k in range(count))):
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
    """Return the chain that is fastest by executed legs, and the number of legs that `drive` executed.

    At each open step `count` evenly spaced headings are tried, and those of `chosen`, the policies'
    choices. Headings are left out if the models predict that all chains through them take `margin`
    s longer than the best; None: all are tried.
    """
    calls, names = trial.chain.calls, [("yaw",)] * len(trial.chain)
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
        legs = [
            with_headings(TopChain((calls[index],)), {0: yaw}) for yaw in headings.ravel().tolist()
        ]
        executed += len(legs)
        return np.reshape([drive(*pair) for pair in zip(worlds, legs, strict=True)], headings.shape)

    values = least_path(lambda steps: [duration(*pairs) for pairs in steps], promising).values
    opened = {i: float(yaw[0]) for i, yaw in enumerate(values) if "yaw" in calls[i].open}
    return with_headings(trial.chain, opened), executed
