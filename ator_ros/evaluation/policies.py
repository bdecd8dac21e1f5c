"""The policies of an evaluation: each chooses the open variables of a trial's chain."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType, SimpleNamespace
from typing import Any

from ator_ros.evaluation.toolset import Toolset
from ator_ros.evaluation.trials import Trial, open_places, open_speeds, reopened, with_headings
from ator_ros.geometry import Pose
from ator_ros.performance.derived import Geometry
from ator_ros.performance.driving import DrivingStyle
from ator_ros.performance.features import PATHS, ROUTE_TIME
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.refinement.refiner import Refinement
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain


@dataclass(frozen=True, slots=True)
class Choice:
    """A chain to execute; its refinement and prediction, if models chose it."""

    chain: TopChain
    refinement: Refinement | None = None
    predicted: ChainPrediction | None = None


Policy = Callable[[Toolset, Trial], Choice]


@dataclass(frozen=True)
class PathTime:
    """A performance model that is not learned: the time of the fastest path or, on a map, of the route.

    `driving` is how the action drives; None: all that the base can do.
    """

    robot: Robot
    driving: DrivingStyle | None = None
    used_variables = PATHS[0].derives
    arrival = None

    def predict(self, direct: Mapping[str, Any], measures: Any = (), signs: Any = None) -> Any:  # noqa: ARG002
        """Return the duration in s, shape (n,), and an error of 0, as none was measured."""
        geometry = Geometry(direct, self.robot, self.driving)
        duration = geometry.path[0] if self.robot.grid is None else ROUTE_TIME.compute(geometry)
        return SimpleNamespace(duration=duration, error_of_sum=(0.0, 0.0))


def naive(tools: Toolset, trial: Trial) -> Choice:
    """Choose the heading at which the first action alone is fastest, at rest (paper, section 5)."""
    chain = tools.refiner().naive(trial.world, open_speeds(trial.chain))
    return Choice(chain, predicted=tools.predict(trial.world, chain))


def fixed(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the heading 0, as in a list of waypoints without headings."""
    return _with_open_headings(trial, [0.0] * (len(trial.chain) - 1))


def arrive(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the bearing from the previous place."""
    places = [trial.world.robot.pose, *(call.goal.pose for call in trial.chain.calls[:-1])]
    return _with_open_headings(trial, _bearings(places))


def face_goal(tools: Toolset, trial: Trial) -> Choice:  # noqa: ARG001
    """Choose the bearing of the next goal."""
    return _with_open_headings(trial, _bearings([call.goal.pose for call in trial.chain.calls]))


def _bearings(places: Sequence[Pose]) -> list[float]:
    """Return the bearing of the next place from each place but the last."""
    return [math.atan2(to.y - here.y, to.x - here.x) for here, to in itertools.pairwise(places)]


def _with_open_headings(trial: Trial, headings: Sequence[float]) -> Choice:
    """Return the chain with these headings at the intermediate subgoals with an open heading."""
    calls = trial.chain.calls
    opened = {at: yaw for at, yaw in enumerate(headings) if calls[at].opens("yaw")}
    return Choice(with_headings(trial.chain, opened))


def analytic(tools: Toolset) -> Toolset:
    """Return tools whose models are path times, as learned models have observed their actions to drive."""
    driving = {action: getattr(model, "driving", None) for action, model in tools.models.items()}
    models = {action: PathTime(tools.robot, seen) for action, seen in driving.items()}
    return dataclasses.replace(tools, models=models)


def refined(
    tools: Toolset,
    trial: Trial,
    *,
    opened: Callable[[TopChain], TopChain] | None = None,
    gated: bool = False,
    learned: bool = True,
) -> Choice:
    """Refine the naive chain: the variables that the plan opens, or the plan changed by `opened`."""
    plan = trial.chain if opened is None else opened(trial.chain)
    start = naive(tools, trial).chain
    refiner = (tools if learned else analytic(tools)).refiner(gated=gated)
    refinement = refiner.refine(trial.world, reopened(start, (call.open for call in plan.calls)))
    return Choice(refinement.chain, refinement, refinement.predicted)


POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        "naive": naive,
        "fixed": fixed,
        "arrive": arrive,
        "face_goal": face_goal,
        "analytic": partial(refined, learned=False),
        "analytic_speed": partial(refined, learned=False, opened=open_speeds),
        "analytic_place": partial(refined, learned=False, opened=open_places),
        "refined": refined,
        "gated": partial(refined, gated=True),
        "refined_speed": partial(refined, opened=open_speeds),
        "gated_speed": partial(refined, opened=open_speeds, gated=True),
        "refined_place": partial(refined, opened=open_places),
    }
)
"""By name; a new policy is a new row. The oracle is no policy, as it executes chains."""
USUAL = tuple(
    name for name in POLICIES if name not in ("fixed", "arrive") and not name.endswith("_place")
)
"""The default policies: a place is free in few chains, and few chains have waypoints only."""
