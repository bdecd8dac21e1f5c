"""The policies of an evaluation: each chooses the open variables of a trial's chain."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from ator_ros.actions.goal_variables import STOP, with_values
from ator_ros.bases.description import Robot
from ator_ros.bases.interface import Driving
from ator_ros.domains.trials import Trial, open_places, open_speeds, reopened, with_headings
from ator_ros.evaluation.orders import (
    Lengths,
    OrderChoice,
    along_routes,
    ordered,
    shortest,
    straight,
)
from ator_ros.evaluation.toolset import Toolset
from ator_ros.geometry import Pose
from ator_ros.performance.derived import Geometry
from ator_ros.performance.features import PATHS, ROUTE_TIME
from ator_ros.performance.model import Prediction
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.refinement.order_search import nearest_next
from ator_ros.refinement.refiner import Refinement
from ator_ros.tops.chain import TopChain


@dataclass(frozen=True, slots=True)
class Choice:
    """A chain to execute.

    Attributes
    ----------
    chain : TopChain
    refinement : Refinement or None
        How the chain was refined; None if it was not.
    predicted : ChainPrediction or None
        Its predicted duration; None if no models chose it.
    """

    chain: TopChain
    refinement: Refinement | None = None
    predicted: ChainPrediction | None = None


Policy = Callable[[Toolset, Trial], Choice]
"""Chooses the open variables of a trial's chain."""


@dataclass(frozen=True)
class PathTime:
    """A performance model that is not learned: the time of the fastest path.

    On a map it is the time of the route.

    Attributes
    ----------
    robot : Robot
    driving : Driving or None
        How the action drives; None: all that the base can do.
    """

    robot: Robot
    driving: Driving | None = None
    used_variables = PATHS[0].derives
    arrival = None

    def predict(
        self,
        direct: Mapping[str, Any],
        measures: Any = (),  # noqa: ARG002
        signs: Any = None,  # noqa: ARG002
    ) -> Prediction:
        """Return durations in s, shape (n,), and an error of 0, as none was measured.

        `direct` are the direct variables of n situations. `measures` and `signs` are for models
        that are learned.
        """
        geometry = Geometry(direct, self.robot, self.driving)
        duration = geometry.path[0] if self.robot.grid is None else ROUTE_TIME.compute(geometry)
        return Prediction(duration, error_of_sum=(np.zeros(()), np.zeros(())))


def naive(tools: Toolset, trial: Trial) -> Choice:
    """Choose the heading at which the first action alone is fastest, at rest (paper, section 5)."""
    chain = tools.refiner().naive(trial.world, open_speeds(trial.chain))
    return Choice(chain, predicted=tools.predict(trial.world, chain))


def fixed(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the heading 0, as in a list of waypoints without headings."""
    return _with_open_headings(trial, [0.0] * len(trial.chain))


def arrive(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the bearing from the previous place."""
    places = [trial.world.robot.pose]
    places += [call.goal.pose for call in trial.chain.calls]
    return _with_open_headings(trial, _bearings(places))


def face_goal(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the bearing of the next goal."""
    places = [call.goal.pose for call in trial.chain.calls]
    return _with_open_headings(trial, _bearings(places))


def _bearings(places: Sequence[Pose]) -> list[float]:
    """Return the bearing of the next place from each place but the last."""
    pairs = itertools.pairwise(places)
    return [math.atan2(to.y - here.y, to.x - here.x) for here, to in pairs]


def _with_open_headings(trial: Trial, headings: Sequence[float]) -> Choice:
    """Return the chain with these headings, from the first call on, where the heading is open."""
    calls = trial.chain.calls
    opened = {at: yaw for at, yaw in enumerate(headings) if calls[at].opens("yaw")}
    return Choice(with_headings(trial.chain, opened))


def analytic(tools: Toolset) -> Toolset:
    """Return tools whose models are path times.

    The paths are those that learned models observed their actions to drive.
    """
    models = {}
    for action, model in tools.models.items():
        driving = getattr(model, "driving", None)
        models[action] = PathTime(tools.robot, driving)
    return dataclasses.replace(tools, models=models)


def refined(
    tools: Toolset,
    trial: Trial,
    *,
    opened: Callable[[TopChain], TopChain] | None = None,
    gated: bool = False,
    learned: bool = True,
) -> Choice:
    """Refine the naive chain (paper, section 5).

    Parameters
    ----------
    tools : Toolset
        The models.
    trial : Trial
        The situation and its plan.
    opened : callable, optional
        Returns the plan with more open variables; by default the plan opens its own.
    gated : bool
        Whether the gate decides about the gain.
    learned : bool
        Whether the learned models predict, or path times.
    """
    plan = trial.chain if opened is None else opened(trial.chain)
    start = naive(tools, trial).chain
    predicting = tools if learned else analytic(tools)
    refiner = predicting.refiner(gated=gated)
    to_refine = reopened(start, (call.open for call in plan.calls))
    refinement = refiner.refine(trial.world, to_refine)
    return Choice(refinement.chain, refinement, refinement.predicted)


def stepwise(tools: Toolset, trial: Trial) -> Choice:
    """Refine the chain without passing: the robot stops at each subgoal."""
    return refined(tools, trial, opened=_with_stops)


def _with_stops(chain: TopChain) -> TopChain:
    return reopened(chain, (call.open - {STOP} for call in chain.calls))


def passing(tools: Toolset, trial: Trial) -> Choice:
    """Pass all subgoals but the last one, in the order in which `stepwise` drives to them."""
    chain = stepwise(tools, trial).chain
    for index in range(len(chain) - 1):
        goal = chain.calls[index].goal
        if STOP in goal.values:
            chain = chain.with_goal(index, with_values(goal, {STOP: 0.0}))
    return Choice(chain, predicted=tools.predict(trial.world, chain))


def in_order(
    tools: Toolset,
    trial: Trial,
    *,
    order: Callable[[Toolset, Trial], TopChain],
    headings: Policy,
) -> Choice:
    """Choose an order, then the headings in this order."""
    return headings(tools, dataclasses.replace(trial, chain=order(tools, trial)))


def as_listed(tools: Toolset, trial: Trial) -> TopChain:  # noqa: ARG001
    """Return the chain in the order in which it is listed."""
    return trial.chain.part(0)


def as_predicted(tools: Toolset, trial: Trial) -> TopChain:
    """Return the chain, with its own headings, in the order that is predicted to be fastest."""
    best = refined(tools, trial).chain.order
    return trial.chain.reordered(best).part(0)


def _by_length(
    tools: Toolset,
    trial: Trial,
    *,
    choose: OrderChoice,
    lengths: Lengths,
) -> TopChain:
    return ordered(tools.robot, trial, choose, lengths)


_ORDERS: Mapping[str, Callable[[Toolset, Trial], TopChain]] = {
    "listed": as_listed,
    "nearest": partial(_by_length, choose=nearest_next, lengths=straight),
    "straight": partial(_by_length, choose=shortest, lengths=straight),
    "route": partial(_by_length, choose=shortest, lengths=along_routes),
    "predicted": as_predicted,
}


def _order_policies() -> dict[str, Policy]:
    """Return each choice of an order with naive and with refined headings.

    The order as listed also has heading 0, as a list of waypoints without headings.
    """
    policies: dict[str, Policy] = {}
    policies["listed_fixed"] = partial(in_order, order=as_listed, headings=fixed)
    for name, order in _ORDERS.items():
        policies[name] = partial(in_order, order=order, headings=naive)
        policies[f"{name}_refined"] = partial(in_order, order=order, headings=refined)
    return policies


_ORDERED = _order_policies()

POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        "naive": naive,
        "fixed": fixed,
        "arrive": arrive,
        "face_goal": face_goal,
        "analytic": partial(refined, learned=False),
        "analytic_speed": partial(refined, learned=False, opened=open_speeds),
        "refined": refined,
        "gated": partial(refined, gated=True),
        "refined_speed": partial(refined, opened=open_speeds),
        "gated_speed": partial(refined, opened=open_speeds, gated=True),
        "refined_place": partial(refined, opened=open_places),
        "stepwise": stepwise,
        "passing": passing,
        **_ORDERED,
    }
)
"""The policies by name. The oracle is no policy, as it executes chains."""
ORDERS = tuple(_ORDERED)
"""The policies that choose an order, for chains that leave it open."""
_UNUSUAL = ("fixed", "arrive", "refined_place", "stepwise", "passing", *ORDERS)
USUAL = tuple(name for name in POLICIES if name not in _UNUSUAL)
"""The default policies: a place is free in few chains, and few chains have waypoints only."""
