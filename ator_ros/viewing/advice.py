"""What refinement says of a chain, as a view shows it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ator_ros.refinement.answer import Refinement, SubgoalCurve
from ator_ros.tops.chain import TopChain


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
    """

    naive: TopChain
    chain: TopChain
    refined: bool
    reason: str
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()
    curves: tuple[SubgoalCurve, ...] = ()

    @property
    def predicted(self) -> tuple[float, ...]:
        """Predicted durations in s of the steps of the chain to execute."""
        return self.after if self.refined else self.before


def advice_of(refinement: Refinement) -> Advice:
    """Return what a refinement says."""
    return Advice(
        refinement.original,
        refinement.chain,
        refinement.refined,
        refinement.reason,
        tuple(action.get("duration", math.nan) for action in refinement.before.actions),
        tuple(action.get("duration", math.nan) for action in refinement.after.actions),
        refinement.curves,
    )
