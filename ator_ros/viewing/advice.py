"""What refinement says of a chain, as a view shows it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.refinement.refiner import Judged, Refinement, Selection, SubgoalCurve
from ator_ros.tops.chain import TopChain


@dataclass(frozen=True, slots=True)
class Candidate:
    """One of several chains for the same end: predicted duration in s, cost, and why it is as it is.

    Both numbers are NaN where it was skipped.
    """

    duration: float
    cost: float
    reason: str


@dataclass(frozen=True, eq=False)
class Advice:
    """The naive chain and the one to execute, with predictions.

    Attributes
    ----------
    naive, chain : TopChain
        The chain with naive values of its free variables, and the chain to execute.
    refined : bool
        Whether they differ.
    reason : str
        Why the chain was refined or left alone: the gate's words.
    before, after : tuple of float
        Predicted durations in s of the steps of `naive`, and of the best chain found; NaN without a model.
    curves : tuple of SubgoalCurve
        What was searched.
    candidates : tuple of Candidate
        The chain and its alternatives, in their order; empty where there are none.
    chosen : int
        The number, from 0, of the candidate that all else is about.
    """

    naive: TopChain
    chain: TopChain
    refined: bool
    reason: str
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()
    curves: tuple[SubgoalCurve, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    chosen: int = 0

    @property
    def predicted(self) -> tuple[float, ...]:
        """Predicted durations in s of the steps of the chain to execute."""
        return self.after if self.refined else self.before


def candidate_of(judged: Judged) -> Candidate:
    """Return what became of one of several chains."""
    prediction = judged.prediction
    if prediction is None:
        return Candidate(math.nan, math.nan, judged.reason)
    return Candidate(prediction.duration, prediction.cost, judged.reason)


def advice_of(refinement: Refinement, selection: Selection | None = None) -> Advice:
    """Return what a refinement says, chosen among others if there is a `selection`."""
    return Advice(
        refinement.original,
        refinement.chain,
        refinement.refined,
        refinement.reason,
        tuple(action.get("duration", math.nan) for action in refinement.before.actions),
        tuple(action.get("duration", math.nan) for action in refinement.after.actions),
        refinement.curves,
        () if selection is None else tuple(map(candidate_of, selection.judged)),
        0 if selection is None else selection.number,
    )
