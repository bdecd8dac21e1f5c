"""A refinement as the service's response and as markers for RViz."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point as PointMessage
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ator_interfaces.msg import Alternative, FreeVariable, NotFree, Performance, SearchCurve
from ator_interfaces.msg import TopChain as TopChainMessage
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import goal_values, with_values
from ator_ros.geometry import Pose
from ator_ros.nodes.conversions import chain_of, echo_of, performance_of, pose_of
from ator_ros.refinement.alternatives import Judged, Selection
from ator_ros.refinement.answer import Refinement, SubgoalCurve
from ator_ros.refinement.chain_model import ChainPrediction
from ator_ros.tops.chain import TopChain

_CANDIDATE_LENGTH = 0.3
_ABOVE_FLOOR = 0.02
_GREY = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.8)
_GREEN = ColorRGBA(r=0.1, g=0.8, b=0.2, a=1.0)


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


def markers_of(refinement: Refinement, *, frame: str) -> MarkerArray:
    """Return markers: candidates from green (best) to red, subgoals before (grey) and after (green)."""
    markers = [Marker(action=Marker.DELETEALL)]
    markers += [_candidates(refinement.original, curve) for curve in refinement.curves]
    for chain, colour in ((refinement.original, _GREY), (refinement.chain, _GREEN)):
        markers += [_arrow(call.goal.pose, colour) for call in chain.calls]
    for number, marker in enumerate(markers):
        marker.header.frame_id, marker.ns, marker.id = frame, "refinement", number
    return MarkerArray(markers=markers)


def _candidates(chain: TopChain, curve: SubgoalCurve) -> Marker:
    """Return a short line from each candidate's position along its heading."""
    marker = Marker(type=Marker.LINE_LIST)
    marker.scale.x = 0.01
    marker.pose = pose_of(Pose(0.0, 0.0, 0.0))
    goal = chain.calls[curve.subgoal].goal
    for values, colour in zip(curve.values, _colours(curve.totals.tolist()), strict=True):
        pose = _candidate(goal, curve.names, values.tolist()).pose
        marker.points += [_point(pose), _point(pose.ahead(-_CANDIDATE_LENGTH))]
        marker.colors += [colour, colour]
    return marker


def _candidate(goal: Goal, names: Sequence[str], values: Sequence[float]) -> Goal:
    return with_values(goal, dict(zip(names, values, strict=True)))


def _colours(costs: Sequence[float]) -> list[ColorRGBA]:
    finite = [cost for cost in costs if math.isfinite(cost)]
    low, high = (min(finite), max(finite)) if finite else (0.0, 0.0)
    shares = [(cost - low) / (high - low) if math.isfinite(cost) and high > low else 1.0 for cost in costs]
    return [ColorRGBA(r=share, g=1.0 - share, b=0.0, a=0.7) for share in shares]


def _arrow(pose: Pose, colour: ColorRGBA) -> Marker:
    marker = Marker(type=Marker.ARROW, color=colour, pose=pose_of(pose))
    marker.pose.position.z = _ABOVE_FLOOR
    marker.scale.x, marker.scale.y, marker.scale.z = 0.4, 0.05, 0.05
    return marker


def _point(pose: Pose) -> PointMessage:
    return PointMessage(x=float(pose.x), y=float(pose.y), z=_ABOVE_FLOOR)
