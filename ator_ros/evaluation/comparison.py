"""Comparison of all policies in one situation, and the oracle.

Every policy chooses a chain, and each distinct chain is executed once. The oracle executes many
chains and takes the best: it begins with the headings that the policies chose, and changes the
subgoals one after another, each to the best of evenly spaced headings, until no change of a single
subgoal makes the chain faster.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ator_ros.actions.base import Goal
from ator_ros.domains.trials import Trial, random_trial
from ator_ros.evaluation.chain_run import ChainRun, run_chain
from ator_ros.evaluation.policies import POLICIES, USUAL, Choice
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.geometry import wrap_angle
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary

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
        Names of `POLICIES`, "naive" among them.
    oracle : int
        Number of evenly spaced headings of each open subgoal that the oracle executes, starting
        with the naive one; 0: no oracle.
    oracle_margin : float or None
        Chains that are predicted to take this much longer than the best (s) are not executed by
        the oracle; None: all are.
    oracle_speeds : tuple of float
        Arrival speeds in m/s besides 0 that a second oracle executes for each heading.
    source : ToolsetSource
        Robot, actions and models.
    """

    seed: int
    chain: str
    policies: tuple[str, ...] = USUAL
    oracle: int = 0
    oracle_margin: float | None = None
    oracle_speeds: tuple[float, ...] = ()
    source: ToolsetSource = field(default_factory=ToolsetSource)


class Executions:
    """Executes chains from one start. Equal chains are executed once.

    Attributes
    ----------
    runs : dict
        The results, by the goals of the chains.
    """

    def __init__(self, tools: Toolset, library: TopLibrary, trial: Trial) -> None:
        limit = tools.domain.time_limit
        self._run = partial(
            run_chain, tools.robot, library, trial.world, time_limit=limit, models=tools.models
        )
        self.runs: dict[tuple[Goal, ...], ChainRun] = {}

    def __call__(self, chain: TopChain) -> ChainRun:
        """Return the run of `chain`, which may differ only in its goals from those before."""
        goals = tuple(call.goal for call in chain.calls)
        if goals not in self.runs:
            self.runs[goals] = self._run(chain)
        return self.runs[goals]


def evaluate_trial(task: tuple[Settings, int]) -> Record:
    """Evaluate all policies in one situation.

    `task` are the settings and the number of the situation.

    Returns
    -------
    dict
        "index"; "start": robot x, y, yaw, first goal x, y, second goal x, y, yaw, if there is one
        (m, rad); "policies": by name "duration" (s), "success", "reason", "error" (m), "chosen":
        heading, speed and declared goal variables of each intermediate subgoal, "actions":
        durations of the actions (s), "predicted" and "spread": duration of the chain and its
        standard deviation (s), "gain" and "uncertainty": the input of the gate (s); "oracle",
        and "oracle_speed" if it also tries speeds: "chosen", "best" (s) and "success"; "executed":
        number of chains executed.
    """
    settings, index = task
    tools, library = tools_of(settings.source)
    trial = random_trial(tools.domain, settings.chain, library, seed=settings.seed, index=index)
    execute = Executions(tools, library, trial)
    choices = {name: POLICIES[name](tools, trial) for name in settings.policies}
    record: Record = {"index": index, "start": _start(trial)}
    record["policies"] = {
        name: _policy_record(choice, execute(choice.chain)) for name, choice in choices.items()
    }
    if settings.oracle:
        chains = [choices["naive"].chain, *(choice.chain for choice in choices.values())]
        oracle = partial(_oracle, settings, tools, trial, execute)
        headings = oracle([0.0], chains)
        record["oracle"] = _oracle_record(headings, execute(headings))
        if settings.oracle_speeds:
            moving = oracle([0.0, *settings.oracle_speeds], [*chains, headings])
            record["oracle_speed"] = _oracle_record(moving, execute(moving))
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
        "chosen": _chosen_values(choice.chain),
        "actions": [round(duration, 3) for duration in run.actions],
    }
    if not run.success:
        record["reason"] = run.reason
    elif not math.isnan(run.error):
        record["error"] = round(run.error, 4)
    if choice.predicted is not None:
        record["predicted"] = round(choice.predicted.duration, 3)
        record["spread"] = round(choice.predicted.spread, 3)
    if choice.refinement is not None and choice.refinement.free:
        record["gain"] = round(choice.refinement.saved, 5)
        record["uncertainty"] = round(choice.refinement.uncertainty, 5)
    return record


def _oracle_record(chain: TopChain, run: ChainRun) -> Record:
    best = round(run.duration, 3)
    return {"chosen": _chosen_values(chain), "best": best, "success": run.success}


def _chosen_values(chain: TopChain) -> list[list[float]]:
    chosen = []
    for call in chain.calls[:-1]:
        goal = call.goal
        declared = [round(value, 4) for value in goal.values.values()]
        chosen.append([round(goal.pose.yaw, 4), round(goal.speed, 3), *declared])
    return chosen


def _oracle(
    settings: Settings,
    tools: Toolset,
    trial: Trial,
    execute: Executions,
    speeds: Sequence[float],
    chosen: Sequence[TopChain],
) -> TopChain:
    """Return the chain of the oracle that executes headings with these arrival speeds.

    `chosen` are the chains of the policies, the naive one first.
    """
    naive = chosen[0]
    starts = [naive] * len(chosen)
    options = {}
    for index, call in enumerate(trial.chain.calls):
        if not call.opens("yaw"):
            continue
        goal = naive.calls[index].goal
        step = 2.0 * math.pi / settings.oracle
        headings = [goal.pose.yaw + step * number for number in range(settings.oracle)]
        pairs = itertools.product(headings, speeds)
        options[index] = [_arriving(goal, yaw, speed) for yaw, speed in pairs]
        for number, chain in enumerate(chosen):
            theirs = chain.calls[index].goal
            speed = theirs.speed if len(speeds) > 1 else speeds[0]
            start = _arriving(goal, theirs.pose.yaw, speed)
            starts[number] = starts[number].with_goal(index, start)
    margin = settings.oracle_margin
    return best_chain(
        starts,
        options,
        duration=lambda chain: execute(chain).duration,
        predicted=lambda chain: tools.predict(trial.world, chain).cost,
        margin=math.inf if margin is None else margin,
    )


def _arriving(goal: Goal, yaw: float, speed: float) -> Goal:
    pose = goal.pose._replace(yaw=wrap_angle(yaw))
    return dataclasses.replace(goal, pose=pose, speed=speed)


def best_chain(
    starts: Sequence[TopChain],
    options: Mapping[int, Sequence[Goal]],
    *,
    duration: Callable[[TopChain], float],
    predicted: Callable[[TopChain], float],
    margin: float = math.inf,
) -> TopChain:
    """Return the fastest chain that is found by changing one subgoal after another.

    No other option of a single subgoal makes it faster, apart from those that `margin` leaves out.

    Parameters
    ----------
    starts : sequence of TopChain
        The search begins with the fastest of them.
    options : mapping of int to sequence of Goal
        Goals to try, by the index of the step.
    duration : callable
        Executes a chain and returns its duration in s.
    predicted : callable
        Returns the predicted duration of a chain in s.
    margin : float
        Options of a subgoal that are predicted to take this much longer than the best of them, in
        s, are not executed.
    """
    best = min(starts, key=duration)
    before = math.inf
    while duration(best) < before:
        before = duration(best)
        for index, goals in options.items():
            chains = [best.with_goal(index, goal) for goal in goals]
            costs = [predicted(chain) for chain in chains]
            bound = min(costs) + margin
            promising = [chain for chain, cost in zip(chains, costs, strict=True) if cost <= bound]
            best = min([best, *promising], key=duration)
    return best
