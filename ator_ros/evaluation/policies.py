"""The policies to compare: each chooses the open variables of a trial's chain."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from ator_ros.domains.domain import Domain
from ator_ros.evaluation.along import Along
from ator_ros.evaluation.trials import Trial, open_places, open_speeds, with_headings
from ator_ros.execution.remaining import with_followed
from ator_ros.geometry import Pose
from ator_ros.refinement.calibration import Calibration
from ator_ros.refinement.chain_prediction import ChainPrediction, PredictsPerformance, predict_chain
from ator_ros.refinement.gate import Gate, OpenGate, opened
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain
from ator_ros.tops.objects import at_rest
from ator_ros.world.state import World

Models = Mapping[str, PredictsPerformance]


@dataclass(frozen=True)
class Toolset:
    """The models and settings from which policies choose.

    Attributes
    ----------
    domain : Domain
        Source of situations and chains.
    robot : Robot
        Sizes and limits.
    models : mapping
        Sets of performance models by name, each a mapping from action name to model; "learned" is always
        there.
    gate : Gate
        The gate of the gated policies.
    gates : mapping
        Gates of other sets of models than the learned one, by the name of the set.
    calibration : Calibration
        Corrections of the learned models' predictions.
    """

    domain: Domain
    robot: Robot
    models: Mapping[str, Models]
    gate: Gate
    calibration: Calibration = field(default_factory=Calibration)
    gates: Mapping[str, Gate] = field(default_factory=dict)

    def refiner(self, models: str = "learned", *, gated: bool = False) -> Refiner:
        """Return a refiner with one of the sets of models."""
        own = self.gate if models == "learned" else self.gates.get(models, OpenGate())
        gate = own if gated else opened(own)
        return Refiner(
            self.robot,
            self.models[models],
            gate,
            ranges=self.domain.ranges,
            calibration=self.calibration,
            failure_cost=self.domain.time_limit,
        )

    def predict(self, world: World, chain: TopChain) -> ChainPrediction:
        """Return the learned models' prediction of a chain as it is, corrected by the calibration."""
        models = self.models["learned"]
        prediction = predict_chain(world, chain, models, self.robot)
        calibration = self.calibration.matching(models)
        return calibration.corrected([(chain, prediction)], world, models, self.robot)[0]


@dataclass(frozen=True, slots=True)
class Choice:
    """A chain to execute, the refinement that led to it, if any, and whether models chose it.

    With `along` it is refined again along the way.
    """

    chain: TopChain
    refinement: Refinement | None = None
    by_models: bool = False
    along: Along | None = None


Policy = Callable[[Toolset, Trial], Choice]


def naive(tools: Toolset, trial: Trial) -> Choice:
    """Choose the heading at which the first action alone is fastest, at rest (paper, section 5)."""
    return Choice(tools.refiner().naive(trial.world, open_speeds(trial.chain)), by_models=True)


def bearing(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the bearing of each subgoal from the preceding position as its heading."""
    places = [trial.world.robot.pose, *(call.goal.pose for call in trial.chain.calls)]
    return Choice(with_headings(trial.chain, _bearings(places[:-1])))


def face_goal(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the bearing of the next goal from each subgoal as its heading."""
    places = [call.goal.pose for call in trial.chain.calls]
    return Choice(with_headings(trial.chain, _bearings(places)))


def _bearings(places: Sequence[Pose]) -> dict[int, float]:
    """Return for each place but the last the bearing in rad of the next."""
    pairs = enumerate(itertools.pairwise(places))
    return {index: math.atan2(to.y - here.y, to.x - here.x) for index, (here, to) in pairs}


def as_planned(chain: TopChain) -> TopChain:
    """Return the chain with what the plan opens."""
    return chain


def refining(
    models: str = "learned", *, gated: bool = False, opened: Callable[[TopChain], TopChain] = as_planned
) -> Policy:
    """Return the policy that refines the naive chain.

    Parameters
    ----------
    models : str
        Name of the set of models in the toolset.
    gated : bool
        Whether the gate decides if the chain is refined.
    opened : callable
        Returns the plan with more opened: arrival speeds, or places.
    """

    def choose(tools: Toolset, trial: Trial) -> Choice:
        start = naive(tools, trial).chain
        chain = reopened(start, opened(trial.chain))
        refinement = tools.refiner(models, gated=gated).refine(trial.world, chain)
        return Choice(refinement.chain, refinement)

    return choose


def refining_again(opened: Callable[[TopChain], TopChain]) -> Policy:
    """Return the policy that refines before the start and again along the way, then behind the gate."""
    once = refining(opened=opened)

    def choose(tools: Toolset, trial: Trial) -> Choice:
        choice = once(tools, trial)
        assert choice.refinement is not None
        along = Along((choice.refinement.original,), tools.refiner(gated=True))
        return dataclasses.replace(choice, along=along)

    return choose


def foreseeing(policy: Policy) -> Policy:
    """Return `policy` with objects that roll taken where they will come to rest."""

    def choose(tools: Toolset, trial: Trial) -> Choice:
        resting = at_rest(trial.world, tools.robot)
        chain = with_followed(trial.chain, resting, tools.robot)
        return policy(tools, Trial(trial.index, resting, chain))

    return choose


def reopened(chain: TopChain, plan: TopChain) -> TopChain:
    """Return the goals of `chain` with what `plan` leaves open."""
    pairs = zip(chain.calls, plan.calls, strict=True)
    return TopChain(tuple(dataclasses.replace(call, open=planned.open) for call, planned in pairs))


MODEL_SETS = (
    "bitbots",
    "bitbots_refitted",
    "booster",
    "booster_refitted",
    "turn_drive_turn",
    "ideal_time",
    "hist_gradient_boosting",
)
"""Sets of models that replace the learned ones, each in the policy of its name."""

OBSERVED = "observed"
"""Models that know nothing but what was observed, and the policy that refines headings with them."""

#: A new policy is a new row. The oracle is no policy: it needs executions.
POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        "naive": naive,
        "bearing": bearing,
        "face_goal": face_goal,
        "refined": refining(),
        "gated": refining(gated=True),
        "refined_speed": refining(opened=open_speeds),
        "gated_speed": refining(gated=True, opened=open_speeds),
        "refined_free": refining(opened=open_places),
        "refined_foreseen": foreseeing(refining(opened=open_speeds)),
        "refined_again": refining_again(opened=open_speeds),
        **{name: refining(name) for name in MODEL_SETS},
        "ideal_time_speed": refining("ideal_time", opened=open_speeds),
        OBSERVED: refining(OBSERVED, gated=True),
        f"{OBSERVED}_speed": refining(OBSERVED, gated=True, opened=open_speeds),
    }
)
