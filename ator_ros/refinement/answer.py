"""What refinement answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ator_ros.geometry import FloatArray
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.refinement.free_variables import FreeVariable
from ator_ros.tops.chain import TopChain


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
        The chain compared with, which is the chain of the request with its open variables filled in, and the
        best chain found.
    free : tuple of FreeVariable
        The variables that were free.
    before, after : ChainPrediction or None
        Predictions for `original` and `best`, corrected by the calibration; None where nothing was free.
    curves : tuple of SubgoalCurve
        What was searched.
    features : mapping
        What the gate decided from, see `ator_ros.refinement.gate.FEATURES`: of the predictions as they were
        before they were corrected. Empty where nothing was free.
    """

    chain: TopChain
    refined: bool
    reason: str
    original: TopChain
    best: TopChain
    free: tuple[FreeVariable, ...] = ()
    before: ChainPrediction | None = None
    after: ChainPrediction | None = None
    curves: tuple[SubgoalCurve, ...] = ()
    features: Mapping[str, float] = field(default_factory=dict)
