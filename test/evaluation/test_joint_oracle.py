"""The oracle that searches all open headings of a chain jointly."""

import itertools
from typing import Any

import numpy as np
import pytest
from refinement_fakes import FakeModel

from ator_ros.domains.domain import find_domain
from ator_ros.evaluation.situation import best_headings, candidates
from ator_ros.evaluation.toolset import Toolset
from ator_ros.evaluation.trials import Trial, random_trial, with_headings
from ator_ros.geometry import wrap_angles
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import World

DOMAIN = find_domain("tour")
ROBOT = DOMAIN.robot()
LIBRARY = DOMAIN.library(ROBOT)


NAMES = ("x", "y", "yaw", "xg", "yg", "yawg")


def turned(x: Any, y: Any, yaw: Any, xg: Any, yg: Any, yawg: Any) -> Any:
    """Return the duration (s) of a drive whose final turn is faster than its first."""
    path = np.arctan2(yg - y, xg - x)
    first, final = np.abs(wrap_angles(path - yaw)), np.abs(wrap_angles(yawg - path))
    return np.hypot(xg - x, yg - y) + first + 0.4 * final**1.5


MODEL = FakeModel(
    lambda direct: turned(*(direct[name] for name in NAMES)), frozenset(NAMES), spread=0.0
)
TOOLS = Toolset(DOMAIN, ROBOT, {"drive_to": MODEL})


def trial(index: int) -> Trial:
    return random_trial(DOMAIN, "tour", LIBRARY, seed=5, index=index)


def drive(start: World, chain: TopChain) -> float:
    return float(turned(*start.robot.pose, *chain.calls[0].goal.pose))


def total(trial: Trial, chain: TopChain) -> float:
    poses = [trial.world.robot.pose, *(call.goal.pose for call in chain.calls)]
    return sum(float(turned(*here, *there)) for here, there in itertools.pairwise(poses))


@pytest.mark.parametrize("index", range(2))
def test_the_oracle_matches_an_exhaustive_search(index: int) -> None:
    drawn = trial(index)
    offered = candidates(drawn, [drawn.chain], 6)
    chain, _ = best_headings(TOOLS, drawn, [drawn.chain], drive, count=6, margin=None)
    every = [
        with_headings(drawn.chain, dict(enumerate(map(float, headings))))
        for headings in itertools.product(*offered)
    ]
    assert total(drawn, chain) == pytest.approx(min(total(drawn, each) for each in every))
    pairs = zip(chain.calls, drawn.chain.calls, strict=True)
    assert all(call.goal == plan.goal for call, plan in pairs if not plan.open)


def test_a_margin_saves_executions_and_keeps_the_best() -> None:
    drawn = trial(1)
    all_legs = best_headings(TOOLS, drawn, [], drive, count=12, margin=None)
    few_legs = best_headings(TOOLS, drawn, [], drive, count=12, margin=0.2)
    assert few_legs[0] == all_legs[0]
    assert few_legs[1] < 0.4 * all_legs[1]
