"""A refinement as the service's response and as markers for RViz."""

from __future__ import annotations

import math

import numpy as np
from visualization_msgs.msg import MarkerArray

from ator_interfaces.msg import Alternative, FreeVariable, NotFree, Performance, SearchCurve
from ator_interfaces.msg import TopChain as TopChainMessage
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.goal_variables import goal_values
from ator_ros.geometry import Pose
from ator_ros.nodes.conversions import chain_of, echo_of, performance_of
from ator_ros.nodes.markers import marker_array
from ator_ros.refinement.alternatives import Judged, Selection
from ator_ros.refinement.answer import Refinement, SubgoalCurve
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.tops.chain import TopChain
from ator_ros.viewing.advice import advice_of
from ator_ros.viewing.chain_picture import picture_of


def answer_of(
    choice: Selection, request: RefineSubgoal.Request, *, action_set: str, frame: str, want_curve: bool
) -> RefineSubgoal.Response:
    """Return the response to a request that was evaluated."""
    response = _response_of(choice.refinement, action_set=action_set, frame=frame, want_curve=want_curve)
    if request.alternatives:
        response.chosen = choice.number
        sent = (request.chain, *request.alternatives)
        response.alternatives = [
            _alternative(judged, chain, action_set=action_set, frame=frame)
            for judged, chain in zip(choice.judged, sent, strict=True)
        ]
    return response


def _alternative(judged: Judged, sent: TopChainMessage, *, action_set: str, frame: str) -> Alternative:
    """Return what became of one of several chains, which was `sent`."""
    found, prediction = judged.refinement, judged.prediction
    if found is None or prediction is None:
        return Alternative(
            reason=judged.reason, chain=echo_of(sent), predicted=performance_of(), cost=math.nan
        )
    return Alternative(
        accepted=True,
        complete=found.complete,
        reason=judged.reason,
        chain=chain_of(found.chain, action_set=action_set, frame=frame),
        predicted=chain_performance_of(prediction),
        cost=prediction.cost,
    )


def _response_of(
    refinement: Refinement, *, action_set: str, frame: str, want_curve: bool
) -> RefineSubgoal.Response:
    before, after = refinement.before, refinement.after
    return RefineSubgoal.Response(
        accepted=True,
        refined=refinement.refined,
        cut_short=not refinement.complete,
        reason=refinement.reason,
        chain=chain_of(refinement.chain, action_set=action_set, frame=frame),
        original=chain_of(refinement.original, action_set=action_set, frame=frame),
        free=_free_variables(refinement),
        not_free=[NotFree(subgoal=n.subgoal, name=n.name, reason=n.reason) for n in refinement.not_free],
        without_model=list(refinement.without_model),
        before=chain_performance_of(before),
        after=chain_performance_of(after),
        before_actions=_actions(before),
        after_actions=_actions(after),
        cost_before=before.cost,
        cost_after=after.cost,
        curves=[_curve(curve) for curve in refinement.curves] if want_curve else [],
    )


def refused(reason: str, chain: TopChainMessage | None = None) -> RefineSubgoal.Response:
    """Return the response to a request that is not evaluated, with its `chain` if that can be sent back."""
    nothing = performance_of()
    sent = TopChainMessage() if chain is None else chain
    return RefineSubgoal.Response(
        reason=reason,
        chain=sent,
        original=sent,
        before=nothing,
        after=nothing,
        cost_before=math.nan,
        cost_after=math.nan,
    )


def chain_performance_of(prediction: ChainPrediction | None) -> Performance:
    """Return the predicted performance of a whole chain; NaN without a prediction."""
    if prediction is None:
        return performance_of()
    success = math.prod(action.get("success", math.nan) for action in prediction.actions)
    spread = prediction.spread if math.isfinite(prediction.duration) else math.nan
    return performance_of({"duration": prediction.duration, "spread": spread, "success": success})


def _actions(prediction: ChainPrediction) -> list[Performance]:
    return [performance_of(action) for action in prediction.actions]


def _free_variables(refinement: Refinement) -> list[FreeVariable]:
    def value(chain: TopChain, subgoal: int, name: str) -> float:
        return goal_values(chain.calls[subgoal].goal)[name]

    return [
        FreeVariable(
            subgoal=variable.subgoal,
            name=variable.name,
            before=value(refinement.original, variable.subgoal, variable.name),
            after=value(refinement.best, variable.subgoal, variable.name),
            low=variable.domain.low,
            high=variable.domain.high,
            limits=list(variable.limits),
        )
        for variable in refinement.free
    ]


def _curve(curve: SubgoalCurve) -> SearchCurve:
    return SearchCurve(
        subgoal=curve.subgoal,
        variables=list(curve.names),
        values=np.ravel(curve.values).tolist(),
        totals=np.ravel(curve.totals).tolist(),
    )


def markers_of(refinement: Refinement, *, start: Pose, frame: str) -> MarkerArray:
    """Return markers for a robot at `start`: the naive chain, the one to execute, and the searched rings."""
    return marker_array(picture_of(start, advice_of(refinement)), "refinement", frame)
