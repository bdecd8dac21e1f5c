"""Direct variables of the steps of a chain, and predicted durations from several situations."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refinement_fakes import (
    ANGLE,
    BOTH,
    ROBOT,
    USED,
    FakeModel,
    call,
    models,
    three_steps,
    turning_time,
    world,
)

from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.field import BALL
from ator_ros.geometry import Pose
from ator_ros.performance.model import Arrival
from ator_ros.refinement.chain_prediction import ChainModel, chain_situations, predict_chain
from ator_ros.refinement.objective import Objective
from ator_ros.refinement.step_durations import predict_durations
from ator_ros.tops.chain import Top, TopCall, TopChain, projected
from ator_ros.tops.conditions import Condition, Term
from ator_ros.world.state import ObjectState, RobotState, World


def moved(frame: Pose, start: World, chain: TopChain) -> tuple[World, TopChain]:
    """Return a plan and its start in another place, turned as a whole."""
    ball = frame.compose(Pose(start.objects[BALL].x, start.objects[BALL].y, 0.0))
    robot = dataclasses.replace(start.robot, pose=frame.compose(start.robot.pose))
    calls = [
        dataclasses.replace(
            each, goal=dataclasses.replace(each.goal, pose=frame.compose(each.goal.pose))
        )
        for each in chain.calls
    ]
    return World(0.0, robot, {BALL: ObjectState(ball.x, ball.y)}), TopChain(tuple(calls))


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_a_prediction_does_not_depend_on_place_and_direction_of_the_whole(
    x: float, y: float, yaw: float
) -> None:
    start, chain = world(), three_steps()
    usual = predict_chain(start, chain, models(), ROBOT)
    again = predict_chain(*moved(Pose(x, y, yaw), start, chain), models(), ROBOT)
    assert again.duration == pytest.approx(usual.duration)
    assert again.cost == pytest.approx(usual.cost)


def test_a_chain_costs_the_sum_of_its_steps() -> None:
    objective = Objective({"duration": 2.0, "success": 3.0})
    state, parts = world(), []
    for step in three_steps(BOTH).calls:
        parts.append(predict_chain(state, TopChain((step,)), models(), ROBOT, objective))
        state = projected(state, step, ROBOT)
    whole = predict_chain(world(), three_steps(BOTH), models(), ROBOT, objective)
    assert whole.cost == pytest.approx(sum(part.cost for part in parts))
    assert whole.duration == pytest.approx(sum(part.duration for part in parts))
    assert whole.spread == pytest.approx(math.hypot(*(part.spread for part in parts)))
    assert [dict(action) for action in whole.actions] == [
        pytest.approx(dict(part.actions[0])) for part in parts
    ]


def test_what_cannot_be_predicted_costs_infinitely_much() -> None:
    broken = FakeModel(lambda direct: math.nan * direct["yawg"], USED)
    known = models() | {"goToPose": broken}
    assert predict_chain(world(), three_steps(), known, ROBOT).cost == math.inf


class Signed(FakeModel):
    """Its errors have a bias of 0.1 s and a spread of 0.2 s, the same for all steps."""

    def predict(
        self, direct: Mapping[str, Any], measures: tuple[str, ...] = (), signs: Any = None
    ) -> Any:
        found = super().predict(direct, measures, signs)
        if signs is not None:
            squares = np.sum(np.square(signs), axis=-1)
            found.error_of_sum = (0.1 * np.sum(signs, axis=-1), 0.04 * squares)
        return found


def test_two_chains_are_compared_step_by_step() -> None:
    known = dict.fromkeys(("goToPose", "dribbleBall", "shoot"), Signed(turning_time, USED))
    chain = three_steps()
    model = ChainModel(
        world(), chain, ROBOT, models=known, names=[("yaw",), ("yaw",), ()], objective=Objective()
    )
    assert [values.tolist() for values in model.given] == [[0.0], [0.0], []]
    other = [np.array([1.0]), np.array([-1.0]), np.zeros(0)]
    before, after, error = model.compare(model.given, other)
    assert before == model.predict() == predict_chain(world(), chain, known, ROBOT)
    assert after.duration != before.duration
    assert after.error == pytest.approx(math.hypot(0.1 * 3.0, 0.2 * math.sqrt(3.0)))
    assert error == pytest.approx((0.0, 0.2 * math.sqrt(6.0)))  # both have the same bias
    costs = model.step_costs(
        [
            (index, values[None], there[None])
            for index, (values, there) in enumerate(zip([np.zeros(0), *other], other, strict=False))
        ]
    )
    assert sum(float(cost[0]) for cost in costs) == pytest.approx(after.cost)


@pytest.mark.parametrize("yaw", [0.0, 2.0, -3.0])
def test_a_robot_that_holds_an_object_starts_behind_it(yaw: float) -> None:
    chain = TopChain((call("goToBall", 1.0, 0.5, yaw), call("dribbleBall", 2.0, 0.0, 0.0)))
    first, second = chain_situations(world(ball=(1.0, 0.5)), chain, ROBOT, models())
    assert [float(first[name][0]) for name in ("xg", "yg", "yawg", "hold")] == [1.0, 0.5, yaw, 1.0]
    start = [float(second[name][0]) for name in ("x", "y", "yaw", "v", "w")]
    assert start == pytest.approx(
        [1.0 - ROBOT.hold * math.cos(yaw), 0.5 - ROBOT.hold * math.sin(yaw), yaw, 0.0, 0.0]
    )


def test_a_step_starts_at_the_speed_at_which_the_one_before_arrives() -> None:
    chain = TopChain(
        (call("goToPose", 1.0, 0.5, 0.3, BOTH, speed=0.4), call("goToPose", 2.0, 0.0, 0.0))
    )
    start = World(0.0, RobotState(Pose(-1.0, 0.0, 0.2), 0.5, -0.6), {})
    first, second = chain_situations(start, chain, ROBOT, models())
    assert [float(first[name][0]) for name in ("x", "y", "yaw", "v", "w", "speedg", "hold")] == [
        -1.0, 0.0, 0.2, 0.5, -0.6, 0.4, 0.0
    ]  # fmt: skip
    assert [float(second[name][0]) for name in ("x", "y", "yaw", "v", "w", "speedg")] == [
        1.0, 0.5, 0.3, 0.4, 0.0, 0.0
    ]  # fmt: skip


def test_a_pure_turn_leaves_the_position_for_the_next_step() -> None:
    turn = Top("turn", "turn", Condition(), Condition((Term("robot.yaw", "goal.yaw", 0.1),)))
    calls = TopCall(turn, Goal(Pose(0.0, 0.0, 1.5))), call("goToPose", 1.0, 1.0, 0.0)
    table = chain_situations(world(x=-1.0, y=0.5), TopChain(calls), ROBOT, models())[1]
    assert [float(table[name][0]) for name in ("x", "y", "yaw")] == [-1.0, 0.5, 1.5]


def test_a_step_begins_where_the_action_before_it_usually_stops() -> None:
    model = FakeModel(turning_time, ANGLE)
    model.arrival = Arrival(dist=0.1, angle=0.2)
    calls = [call("goToPose", 1.0, 0.0, yaw) for yaw in (1.5, -0.1, 0.0)]
    tables = chain_situations(
        world(x=-1.0, y=0.0), TopChain(tuple(calls)), ROBOT, {"goToPose": model}
    )
    starts = [[float(table[name][0]) for name in ("x", "y", "yaw")] for table in tables]
    assert starts[1] == pytest.approx([0.9, 0.0, 1.3])
    assert starts[2] == pytest.approx([0.9, 0.0, 0.0])


WORLDS = [world(x=-1.0), world(x=1.0, y=0.5), world(y=-1.0)]
CALLS = [
    call("goToPose", 1.0, 0.0, 0.0),
    call("shoot", 2.0, 0.0, 0.0),
    call("goToPose", 0.0, 1.0, 1.0),
]


def test_each_step_is_predicted_from_each_situation_as_in_a_chain() -> None:
    found = predict_durations(WORLDS, CALLS, models())
    for row, start in enumerate(WORLDS):
        for column, step in enumerate(CALLS):
            chain = predict_chain(start, TopChain((step,)), models(), ROBOT)
            assert found.durations[row, column] == pytest.approx(chain.duration)
            assert found.spreads[row, column] == pytest.approx(chain.spread)
            assert found.success[row, column] == pytest.approx(chain.actions[0]["success"])
