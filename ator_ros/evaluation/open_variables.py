"""What each open goal variable of a chain is predicted to gain, and why if it gains nothing."""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

from ator_ros.evaluation.toolset import Toolset
from ator_ros.evaluation.trials import Trial, open_speeds
from ator_ros.refinement.free_variables import Cause, NotFree
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


@dataclass
class _Findings:
    """Results for one variable: gains where it was free, how often the gate accepted, and reasons."""

    gains: list[float] = field(default_factory=list)
    accepted: int = 0
    closed: Counter[str] = field(default_factory=Counter)
    limits: Counter[str] = field(default_factory=Counter)


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
    findings: defaultdict[tuple[int, str, str], _Findings] = defaultdict(_Findings)
    for trial in trials:
        plan = open_speeds(trial.chain)
        naive = refiner.naive(trial.world, plan)
        for index, call in enumerate(plan.calls):
            for name in sorted(call.open):
                found = findings[index + 1, call.top.name, name]
                result = refiner.refine(trial.world, _opening(naive, index, name))
                found.closed.update(_explained(each) for each in result.not_free)
                if result.free:
                    found.gains.append(max(0.0, result.before.cost - result.after.cost))
                    found.accepted += result.refined
                    found.limits.update(each for variable in result.free for each in variable.limits)
    return tuple(_summary(*key, found) for key, found in sorted(findings.items()))


def _opening(chain: TopChain, index: int, name: str) -> TopChain:
    """Return the chain with one variable open and all others committed to."""
    calls = (
        dataclasses.replace(call, open=frozenset({name}) if number == index else frozenset())
        for number, call in enumerate(chain.calls)
    )
    return TopChain(tuple(calls))


def _explained(variable: NotFree) -> str:
    """Return why a variable was not free, with the kind of cause first."""
    bound = variable.cause is Cause.BOUND
    return variable.reason if bound else f"{variable.cause.value}: {variable.reason}"


def _summary(step: int, top: str, name: str, found: _Findings) -> OpenVariable:
    closed, free = found.closed.total(), len(found.gains)
    gain = sum(found.gains) / free if free else 0.0
    if closed > free:
        explanation = found.closed.most_common(1)[0][0]
    elif gain <= NO_EFFECT:
        explanation = f"no effect: the models predict a gain of {gain:.2f} s on average"
    elif not found.accepted:
        explanation = f"the gate refuses all gains: {gain:.2f} s on average is too uncertain"
    else:
        explanation = (
            f"gains {gain:.2f} s on average; the gate accepts it in {found.accepted} of {free} situations"
        )
    if closed <= free and found.limits:
        explanation += f"; searched within limits: {found.limits.most_common(1)[0][0]}"
    share = free / (closed + free) if closed + free else 0.0
    return OpenVariable(step, top, name, round(share, 3), round(gain, 3), explanation)
