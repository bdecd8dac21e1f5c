"""What the page asks refinement, as messages."""

from __future__ import annotations

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.evaluation.trials import random_trial
from ator_ros.nodes.advice import objective_of
from ator_ros.refinement.objective import expected_time
from ator_ros.viewing.draft import Draft

LIBRARY = SOCCER.library(SOCCER.robot())


def test_what_a_failure_costs_is_left_to_the_node_until_it_is_weighed() -> None:
    trial = random_trial(SOCCER, "dribble", LIBRARY, seed=403, index=0)
    draft = Draft(trial.world, trial.chain, "default", expected_time(30.0))
    left = objective_of(draft.objective)
    assert (left.duration, left.success, left.accuracy) == (1.0, -1.0, 0.0)
    assert objective_of(draft.with_weight("accuracy", 2.0).objective).success == -1.0
    assert objective_of(draft.with_weight("success", 12.0).objective).success == 12.0
