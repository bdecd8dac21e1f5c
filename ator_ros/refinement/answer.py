"""What refinement answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.refinement.free_variables import FreeVariable, NotFree
from ator_ros.tops.chain import TopChain

_MOST_TOLD = 6


@dataclass(frozen=True, slots=True)
class SubgoalCurve:
    """What was searched at one subgoal: candidates of its free variables and the best chain through each.

    Attributes
    ----------
    subgoal : int
        Counted from 0.
    names : tuple of str, length k
        The free variables.
    values : ndarray, shape (n, k)
        Candidates in m, rad, m/s.
    totals : ndarray, shape (n,)
        Cost of the whole chain, the other subgoals at their best for this candidate.
    """

    subgoal: int
    names: tuple[str, ...]
    values: FloatArray
    totals: FloatArray


@dataclass(frozen=True, slots=True)
class Refinement:
    """The answer to a request.

    Attributes
    ----------
    chain : TopChain
        The refined chain, or the chain of the request when `refined` is False.
    refined : bool
        Whether a subgoal was changed.
    reason : str
        Why the chain was refined or left alone.
    original, best : TopChain
        The chain compared with, which is the chain of the request, its placeholders filled in, and the best
        chain found.
    before, after : ChainPrediction
        Predictions for `original` and for `best`, corrected by the calibration.
    free : tuple of FreeVariable
        The variables that were free.
    not_free : tuple of NotFree
        The variables that the plan opens and that were not free, with the reasons.
    without_model : tuple of int
        The steps (from 0) whose action has no performance model.
    curves : tuple of SubgoalCurve
        What was searched.
    features : mapping
        What the gate decided from, see `ator_ros.refinement.gate.FEATURES`: of the predictions before their
        calibration, unless the gate wants it. Empty where nothing was free.
    complete : bool
        Whether everything was searched before time was up; otherwise `best` is the best found until then.
    """

    chain: TopChain
    refined: bool
    reason: str
    original: TopChain
    best: TopChain
    before: ChainPrediction
    after: ChainPrediction
    free: tuple[FreeVariable, ...] = ()
    not_free: tuple[NotFree, ...] = ()
    without_model: tuple[int, ...] = ()
    curves: tuple[SubgoalCurve, ...] = ()
    features: Mapping[str, float] = field(default_factory=dict)
    complete: bool = True


def why_nothing_free(chain: TopChain, not_free: Sequence[NotFree]) -> str:
    """Return why nothing of a chain can be refined, in words."""
    if not any(call.open for call in chain.calls):
        return "nothing is open: the plan commits to every goal variable"
    return f"nothing is free: {_told(chain, not_free)}"


def remarks(
    chain: TopChain, not_free: Sequence[NotFree], without_model: Sequence[int], outside: Sequence[str]
) -> str:
    """Return what is to be said beside the gate's reason; empty, or it begins with a semicolon.

    What "*" opened appears only in `Refinement.not_free`: not all of it is expected to be free.
    """
    said = ""
    named = [each for each in not_free if each.name in chain.calls[each.subgoal].open]
    if named:
        said += f"; not free: {_told(chain, named)}"
    if without_model:
        steps = _listed([f"step {step + 1} ({chain.calls[step].top.action})" for step in without_model])
        said += f"; no performance model for {steps}: neither predicted nor counted"
    if outside:
        said += f"; extrapolated: {_listed(outside)}"
    return said


def _told(chain: TopChain, not_free: Sequence[NotFree]) -> str:
    tops = [chain.calls[each.subgoal].top.name for each in not_free]
    return _listed(
        [
            f"{each.name} of step {each.subgoal + 1} ({top}) is {each.reason}"
            for each, top in zip(not_free, tops, strict=True)
        ]
    )


def _listed(items: Sequence[str]) -> str:
    """Join a few items; of many, the first ones and how many more there are."""
    more = len(items) - _MOST_TOLD
    return "; ".join(items[:_MOST_TOLD]) + (f"; and {more} more" if more > 0 else "")
