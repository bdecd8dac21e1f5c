"""What the service refine_subgoal answers, read as a view shows it."""

from __future__ import annotations

import numpy as np

from ator_interfaces.msg import SearchCurve
from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes.checks import MessageError
from ator_ros.nodes.conversions import chain_from
from ator_ros.refinement.answer import SubgoalCurve
from ator_ros.tops.library import TopLibrary
from ator_ros.viewing.advice import Advice


def advice_from(answer: RefineSubgoal.Response, library: TopLibrary, *, frame: str) -> Advice:
    """Read an answer to a request that was accepted.

    Raises
    ------
    MessageError
        A chain or a curve in it cannot be read.
    """
    naive = chain_from(answer.original, library, frame=frame, where="original")
    return Advice(
        naive,
        chain_from(answer.chain, library, frame=frame),
        answer.refined,
        answer.reason,
        tuple(action.duration for action in answer.before_actions),
        tuple(action.duration for action in answer.after_actions),
        tuple(_curve_from(curve, len(naive.calls)) for curve in answer.curves),
    )


def _curve_from(curve: SearchCurve, steps: int) -> SubgoalCurve:
    names, totals = tuple(curve.variables), np.asarray(curve.totals, dtype=float)
    if curve.subgoal >= steps or len(curve.values) != len(names) * len(totals):
        raise MessageError(
            f"curves: expected {len(names)} values for each of {len(totals)} totals, of a subgoal below "
            f"{steps}, got {len(curve.values)} of subgoal {curve.subgoal}"
        )
    values = np.asarray(curve.values, dtype=float).reshape(len(totals), len(names))
    return SubgoalCurve(curve.subgoal, names, values, totals)
