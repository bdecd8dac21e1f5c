"""The policies that are compared: each chooses the open variables of a trial's chain."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType, SimpleNamespace
from typing import Any

from ator_ros.evaluation.toolset import Toolset
from ator_ros.evaluation.trials import Trial, open_places, open_speeds, reopened, with_headings
from ator_ros.performance.derived import Geometry
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import PATHS
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.refinement.gate import NO_GATE
from ator_ros.refinement.refiner import Refinement
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain


@dataclass(frozen=True, slots=True)
class Choice:
    """A chain to execute, its refinement and prediction, if models chose it."""

    chain: TopChain
    refinement: Refinement | None = None
    predicted: ChainPrediction | None = None


Policy = Callable[[Toolset, Trial], Choice]


@dataclass(frozen=True)
class PathTime:
    """A performance model that is not learned: the time of the fastest turn-straight-turn path.

    Attributes
    ----------
    robot : Robot
        The robot.
    driving : DrivingStyle or None
        How the action drives; None: all that the base can do.
    """

    robot: Robot
    driving: DrivingStyle | None = None
    used_variables = PATHS[0].derives

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ()) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and nothing else."""
        return SimpleNamespace(duration=Geometry(direct, self.robot, self.driving).path.time)


def naive(tools: Toolset, trial: Trial) -> Choice:
    """Choose the heading at which the first action alone is fastest, at rest (paper, section 5)."""
    chain = tools.refiner().naive(trial.world, open_speeds(trial.chain))
    return Choice(chain, predicted=tools.predict(trial.world, chain))


def face_goal(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the bearing of the next goal as the heading of each subgoal that leaves it open."""
    calls = trial.chain.calls
    places = enumerate(itertools.pairwise(call.goal.pose for call in calls))
    bearings = {
        index: math.atan2(to.y - here.y, to.x - here.x)
        for index, (here, to) in places
        if calls[index].opens("yaw")
    }
    return Choice(with_headings(trial.chain, bearings))


def analytic(tools: Toolset) -> Toolset:
    """Return tools whose models are path times, as learned models have observed their actions to drive."""
    driving = {action: getattr(model, "driving", None) for action, model in tools.models.items()}
    models = {action: PathTime(tools.robot, seen) for action, seen in driving.items()}
    return dataclasses.replace(tools, models=models, gate=NO_GATE)


def refined(
    tools: Toolset,
    trial: Trial,
    *,
    opened: Callable[[TopChain], TopChain] | None = None,
    gated: bool = False,
    learned: bool = True,
) -> Choice:
    """Refine the naive chain: what `opened` leaves open, or else the plan."""
    plan = trial.chain if opened is None else opened(trial.chain)
    start = naive(tools, trial).chain
    refiner = (tools if learned else analytic(tools)).refiner(gated=gated)
    refinement = refiner.refine(trial.world, reopened(start, (call.open for call in plan.calls)))
    return Choice(refinement.chain, refinement, refinement.predicted)


POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        "naive": naive,
        "face_goal": face_goal,
        "analytic": partial(refined, learned=False),
        "analytic_speed": partial(refined, learned=False, opened=open_speeds),
        "refined": refined,
        "gated": partial(refined, gated=True),
        "refined_speed": partial(refined, opened=open_speeds),
        "gated_speed": partial(refined, opened=open_speeds, gated=True),
        "refined_place": partial(refined, opened=open_places),
    }
)
"""By name; a new policy is a new row. The oracle is no policy, as it executes chains."""
USUAL = tuple(name for name in POLICIES if name != "refined_place")
"""Those of an evaluation that names none: in few chains a place is free."""
