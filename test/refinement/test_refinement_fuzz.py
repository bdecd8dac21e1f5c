"""Whatever numbers a request holds: an answer, or an error of our own."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from refinement_fakes import ALL, LIBRARY, ROBOT, models

from ator_ros.actions.base import Goal, Point
from ator_ros.domains.soccer.field import BALL
from ator_ros.geometry import Pose
from ator_ros.refinement import RefinementError
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World

NUMBERS = st.one_of(
    st.floats(-4.0, 4.0),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -0.0, 1e308, -1e308, 5e-324, math.pi, -math.pi]),
)
POSES = st.builds(Pose, NUMBERS, NUMBERS, NUMBERS)
GOALS = st.builds(Goal, POSES, NUMBERS, st.sampled_from(Point))
CALLS = st.builds(
    TopCall, st.sampled_from(list(LIBRARY.values())), GOALS, st.frozensets(st.sampled_from(sorted(ALL)))
)
CHAINS = st.builds(lambda calls: TopChain(tuple(calls)), st.lists(CALLS, max_size=4))
WORLDS = st.builds(
    World,
    NUMBERS,
    st.builds(RobotState, POSES, NUMBERS, NUMBERS),
    st.just({}) | st.builds(lambda there: {BALL: there}, st.builds(ObjectState, NUMBERS, NUMBERS)),
)
WEIGHTS = st.dictionaries(st.sampled_from(["duration", "success", "accuracy", "beauty"]), NUMBERS)
REFINER = Refiner(ROBOT, models())


@settings(deadline=None, max_examples=200, derandomize=True)
@given(WORLDS, CHAINS, WEIGHTS)
def test_requests_end_in_an_answer_or_an_error_of_ours(
    world: World, chain: TopChain, weights: dict[str, float]
) -> None:
    try:
        refinement = REFINER.refine(world, chain, Objective(weights))
    except RefinementError as error:
        if "expected" not in str(error):
            raise
        return
    assert refinement.reason
    for old, new in zip(chain.calls, refinement.chain.calls, strict=True):
        kept = ALL - old.open
        before = {**old.goal.pose._asdict(), "speed": old.goal.speed}
        after = {**new.goal.pose._asdict(), "speed": new.goal.speed}
        assert {name: before[name] for name in kept} == {name: after[name] for name in kept}
