"""What a view asks refinement and executor, and what refinement answers."""

from __future__ import annotations

import numpy as np

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Objective as ObjectiveMessage
from ator_interfaces.msg import SearchCurve, TopChain
from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes.messages import chain_from, chain_of, situation_of
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.tops.library import TopLibrary
from ator_ros.viewing.advice import Advice, Candidate
from ator_ros.viewing.draft import Draft
from ator_ros.world.messages import MessageError


def request_of(draft: Draft, *, frame: str, as_given: bool = False) -> RefineSubgoal.Request:
    """Write what refine_subgoal is asked about a draft; `as_given`: its open values are no placeholders."""
    chain, *others = chains_of(draft, frame=frame)
    return RefineSubgoal.Request(
        situation=situation_of(draft.world, frame=frame),
        chain=chain,
        objective=objective_of(draft.objective),
        alternatives=others,
        want_curve=True,
        as_given=as_given,
    )


def goal_of(draft: Draft, *, frame: str, refine: bool) -> ExecuteChain.Goal:
    """Write the goal that executes the chain of a draft."""
    chain, *others = chains_of(draft, frame=frame)
    objective = objective_of(draft.objective)
    return ExecuteChain.Goal(chain=chain, refine=refine, objective=objective, alternatives=others)


def chains_of(draft: Draft, *, frame: str) -> list[TopChain]:
    """Write the chain of a draft and its alternatives."""
    chains = (draft.chain, *draft.alternatives)
    return [chain_of(chain, action_set=draft.action_set, frame=frame) for chain in chains]


def objective_of(objective: Objective) -> ObjectiveMessage:
    """Write an objective; a measure that it does not name has no weight, one left to the node -1."""
    names = ObjectiveMessage.get_fields_and_field_types()
    weights = {name: float(objective.weights.get(name, 0.0)) for name in names}
    return ObjectiveMessage(**weights | dict.fromkeys(objective.where_predicted, -1.0))


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
        tuple(Candidate(each.predicted.duration, each.cost, each.reason) for each in answer.alternatives),
        answer.chosen,
    )


def _curve_from(curve: SearchCurve, steps: int) -> SubgoalCurve:
    names, totals = tuple(curve.variables), np.asarray(curve.totals, dtype=float)
    if curve.subgoal >= steps or len(curve.values) != len(names) * len(totals):
        raise MessageError(
            f"curves: expected {len(names)} values for each of {len(totals)} totals, and a subgoal "
            f"from 0 to {steps - 1}; got {len(curve.values)} values, and subgoal {curve.subgoal}"
        )
    values = np.asarray(curve.values, dtype=float).reshape(len(totals), len(names))
    return SubgoalCurve(curve.subgoal, names, values, totals)
