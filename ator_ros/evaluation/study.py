"""The results of `study` and their page: actions, models, and the gain of each open variable."""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import pandas as pd

from ator_ros.evaluation.report import Part, page, policy_table
from ator_ros.evaluation.toolset import Toolset
from ator_ros.evaluation.trials import Trial, open_speeds
from ator_ros.refinement.refiner import Refinement
from ator_ros.tops.chain import TopChain

NO_EFFECT = 0.02
"""Predicted gain in s up to which a variable counts as without effect: less than half a control period."""


@dataclass(frozen=True)
class OpenVariable:
    """One open goal variable, over all situations of a study.

    Attributes
    ----------
    step : int
        The step that leaves it open, from 1.
    top, name : str
        The step's TOP, and the variable.
    free : float
        Share of the situations in which it was free.
    gain_s : float
        Mean predicted gain if it alone is chosen.
    explanation : str
        What it gains, or why it gains nothing.
    """

    step: int
    top: str
    name: str
    free: float
    gain_s: float
    explanation: str


def open_variables(tools: Toolset, trials: Iterable[Trial]) -> tuple[OpenVariable, ...]:
    """Refine each open variable alone, with arrival speeds open too, and explain the result.

    Parameters
    ----------
    tools : Toolset
        Learned models and their gate.
    trials : iterable of Trial
        Situations with chains.
    """
    refiner = tools.refiner(gated=True)
    found: defaultdict[tuple[int, str, str], list[Refinement]] = defaultdict(list)
    for trial in trials:
        plan = open_speeds(trial.chain)
        naive = refiner.naive(trial.world, plan)
        for index, call in enumerate(plan.calls):
            for name in sorted(call.open):
                result = refiner.refine(trial.world, _opening(naive, index, name))
                found[index + 1, call.top.name, name].append(result)
    return tuple(_summary(*key, results) for key, results in sorted(found.items()))


def _opening(chain: TopChain, index: int, name: str) -> TopChain:
    """Return the chain with one variable open and all others committed to."""
    calls = (
        dataclasses.replace(call, open=frozenset({name}) if number == index else frozenset())
        for number, call in enumerate(chain.calls)
    )
    return TopChain(tuple(calls))


def _summary(step: int, top: str, name: str, results: list[Refinement]) -> OpenVariable:
    """Return what one variable gained in all situations, and why."""
    closed = Counter(each.reason for result in results for each in result.not_free)
    refined = [result for result in results if result.free]
    limits = Counter(each for result in refined for variable in result.free for each in variable.limits)
    accepted, free = sum(result.refined for result in refined), len(refined)
    gain = sum(max(0.0, each.before.cost - each.after.cost) for each in refined) / free if free else 0.0
    if closed.total() > free:
        explanation = closed.most_common(1)[0][0]
    elif gain <= NO_EFFECT:
        explanation = f"no effect: the models predict a gain of {gain:.2f} s on average"
    elif not accepted:
        explanation = f"the gate refuses all gains: {gain:.2f} s on average is too uncertain"
    else:
        explanation = f"gains {gain:.2f} s on average; the gate accepts it in {accepted} of {free} situations"
    if closed.total() <= free and limits:
        explanation += f"; searched within limits: {limits.most_common(1)[0][0]}"
    share = free / (closed.total() + free) if results else 0.0
    return OpenVariable(step, top, name, round(share, 3), round(gain, 3), explanation)


KIND = "study"
SETTINGS = "study settings"


@dataclass(frozen=True)
class StudySettings:
    """What the files of a study depend on.

    Attributes
    ----------
    description_digest, domain, action_set : str
        Digest of robot and scene, and names of domain and action set.
    episodes : int
        Of each action.
    situations : int
        Number of situations of the gate, and of others of the evaluation.
    seed : int
        Seed of the episodes; fresh episodes, gate and evaluation use the three seeds after it.
    chain : str or None
        The chain of the evaluation, if the robot can execute it.
    oracle : int
        Number of headings of the first subgoal that the oracle executes.
    """

    description_digest: str
    domain: str
    action_set: str
    episodes: int
    situations: int
    seed: int
    chain: str | None
    oracle: int


@dataclass(frozen=True)
class MeasuredAction:
    """Performance of an action over all its episodes, and accuracy of its model.

    Attributes
    ----------
    episodes : int
        Number of episodes.
    success : float
        Share that succeeded.
    mean_duration_s : float or None
        Of the successes; None without any.
    accuracy : dict
        As in the file of its model; empty without one.
    failures : dict
        Reasons of failures and their numbers.
    """

    episodes: int
    success: float
    mean_duration_s: float | None
    accuracy: dict[str, Any]
    failures: dict[str, int]


@dataclass(frozen=True)
class StudyResult:
    """The content of the file that `study` writes.

    Attributes
    ----------
    command : str
        The command that wrote it.
    robot, robot_digest : str
        Name and digest of the robot's description.
    domain, action_set : str
        Domain and action set.
    actions : mapping of str to MeasuredAction
        The actions that the robot can execute, by name.
    left_out : mapping of str to str
        The other actions, with the reason.
    chain : str or None
        The chain that was evaluated; None without one.
    evaluation : mapping or None
        Summary of its evaluation, as in `evaluation.json`.
    variables : tuple of OpenVariable
        The open variables of the chain, with their gains.
    """

    command: str
    robot: str
    robot_digest: str
    domain: str
    action_set: str
    actions: dict[str, MeasuredAction]
    left_out: dict[str, str]
    chain: str | None
    evaluation: dict[str, Any] | None
    variables: tuple[OpenVariable, ...] = ()


def study_page(result: StudyResult) -> str:
    """Return the HTML page of a study."""
    parts: list[Part] = [
        ("p", f"Domain {result.domain}, action set {result.action_set}."),
        ("h2", "Actions"),
        pd.DataFrame(
            {
                "action": name,
                "episodes": row.episodes,
                "success": f"{100 * row.success:.2f} %",
                "mean duration, s": "-" if row.mean_duration_s is None else f"{row.mean_duration_s:.2f}",
                "model's MAE, s": f"{row.accuracy['mae_s']:.3f}" if "mae_s" in row.accuracy else "-",
                "RMSE, s": f"{row.accuracy['rmse_s']:.3f}" if "rmse_s" in row.accuracy else "-",
            }
            for name, row in result.actions.items()
        ),
    ]
    if result.left_out:
        parts += [
            ("h2", "What this robot cannot do"),
            pd.DataFrame(result.left_out.items(), columns=["action", "why"]),
        ]
    if result.evaluation is None:
        parts.append(("p", "No chain of the domain can be executed by this robot."))
    else:
        parts += [
            ("h2", f"Refinement of the chain {result.chain}"),
            policy_table(result.evaluation),
            ("p", "The evaluation in full: evaluation/report.html"),
        ]
    if result.variables:
        variables = pd.DataFrame(
            {
                "step": f"{each.step} ({each.top})",
                "open variable": each.name,
                "free in": f"{100 * each.free:.0f} %",
                "predicted gain alone, s": f"{each.gain_s:.2f}",
                "explanation": each.explanation,
            }
            for each in result.variables
        )
        parts += [("h2", "Open variables"), variables]
    parts += [("h2", "To repeat this"), ("pre", result.command)]
    return page(f"{result.robot}: actions and their refinement", parts)
