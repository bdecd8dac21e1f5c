"""Direct variables of the steps of a chain, and predicted durations from several situations."""

import numpy as np
import pytest
from refinement_fakes import ANGLE, ROBOT, FakeModel, call, turning_time, world

from ator_ros.actions.base import Goal
from ator_ros.geometry import Pose
from ator_ros.performance.model import Arrival
from ator_ros.refinement.chain_prediction import chain_situations, predict_chain
from ator_ros.refinement.durations import predict_durations
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term


def test_a_pure_turn_leaves_the_position_for_the_next_step() -> None:
    turn = Top("turn", "turn", Condition(), Condition((Term("robot.yaw", "goal.yaw", 0.1),)))
    calls = TopCall(turn, Goal(Pose(0.0, 0.0, 1.5))), call("goToPose", 1.0, 1.0, 0.0)
    table = chain_situations(world(x=-1.0, y=0.5), TopChain(calls), ROBOT, {})[1]
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
    models = {"goToPose": FakeModel(turning_time, ANGLE)}
    found = predict_durations(WORLDS, CALLS, models)
    for row, start in enumerate(WORLDS):
        for column in (0, 2):
            chain = predict_chain(start, TopChain((CALLS[column],)), models, ROBOT)
            assert found.durations[row, column] == pytest.approx(chain.duration)
            assert found.spreads[row, column] == pytest.approx(chain.spread)
            assert found.success[row, column] == pytest.approx(chain.actions[0]["success"])


def test_a_step_without_a_model_is_not_predicted() -> None:
    found = predict_durations(WORLDS, CALLS, {})
    assert np.isnan(found).all()
    assert found.durations.shape == (3, 3)
