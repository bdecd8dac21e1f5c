"""Whatever numbers a request holds: an answer, or an error of our own."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from refinement_fakes import ALL, ANGLE, LIBRARY, NOTHING, ROBOT, models

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


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(-math.pi, math.pi))
def test_answers_do_not_depend_on_where_the_origin_is(x: float, y: float, yaw: float) -> None:
    frame = Pose(x, y, yaw)
    start, ball, goal = Pose(-1.0, 0.5, 0.3), Pose(0.0, 0.0, 0.0), Pose(1.5, -1.0, 2.0)

    def refined(origin: Pose) -> float:
        here = [origin.compose(pose) for pose in (start, ball, goal)]
        opened = [ANGLE, NOTHING]
        tops = (LIBRARY["goToBall"], LIBRARY["dribbleBall"])
        calls = [
            TopCall(top, Goal(pose, 0.0, Point.HOLD), names)
            for top, pose, names in zip(tops, here[1:], opened, strict=True)
        ]
        result = REFINER.refine(World(0.0, RobotState(here[0])), TopChain(tuple(calls)))
        return result.after.cost

    # The grid of headings does not turn with the frame: its step of 5 degrees is what may differ.
    assert math.isclose(refined(frame), refined(Pose(0.0, 0.0, 0.0)), abs_tol=0.15)
