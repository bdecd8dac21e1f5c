"""Objective and refiner: the refined chain is optimal, and bound variables are unchanged."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from refinement_fakes import (
    BOTH,
    ROBOT,
    USED,
    FakeModel,
    call,
    models,
    three_steps,
    turning_time,
    two_steps,
    world,
)

from ator_ros.geometry import wrap_angle
from ator_ros.refinement import RefinementError
from ator_ros.refinement.objective import Objective, expected_time
from ator_ros.refinement.refiner import LONGEST_CHAIN, Refiner
from ator_ros.tops.chain import TopChain


@pytest.mark.parametrize("chain", [two_steps(), two_steps(BOTH), three_steps(), three_steps(BOTH)])
def test_refined_chain_costs_what_was_predicted_and_less(chain: TopChain) -> None:
    refiner = Refiner(ROBOT, models())
    result = refiner.refine(world(), chain)
    assert result.refined
    assert result.after.cost < result.before.cost
    again = refiner.refine(world(), result.chain)
    assert again.before.cost == pytest.approx(result.after.cost, abs=1e-9)


def test_committed_variables_are_unchanged() -> None:
    chain = three_steps()
    refined = Refiner(ROBOT, models()).refine(world(), chain).chain
    for old, new in zip(chain.calls, refined.calls, strict=True):
        assert new == dataclasses.replace(old, goal=new.goal)
        assert new.goal.pose[:2] == old.goal.pose[:2]
        assert new.goal.speed == old.goal.speed
    assert refined.calls[-1] == chain.calls[-1]


def test_naive_is_fastest_for_the_first_action_alone() -> None:
    chain = Refiner(ROBOT, models()).naive(world(), two_steps(BOTH))
    assert wrap_angle(chain.calls[0].goal.pose.yaw) == pytest.approx(0.0, abs=math.radians(5))
    assert chain.calls[0].goal.speed == 0.0


def test_open_variables_are_compared_with_the_naive_chain() -> None:
    refiner = Refiner(ROBOT, models())
    results = [refiner.refine(world(), two_steps(yaw=yaw), placeholders=True) for yaw in (0.0, 2.0)]
    expected = refiner.refine(world(), refiner.naive(world(), two_steps()))
    for result in results:
        assert result.original == expected.original
        assert (result.chain, result.before) == (expected.chain, expected.before)
        assert result.reason == expected.reason


def test_weight_on_success_lowers_the_arrival_speed() -> None:
    refiner = Refiner(ROBOT, models())
    fast = refiner.refine(world(), two_steps(BOTH), Objective({"duration": 1.0}))
    safe = refiner.refine(world(), two_steps(BOTH), Objective({"duration": 1.0, "success": 20.0}))
    assert fast.chain.calls[0].goal.speed > 0.3
    assert safe.chain.calls[0].goal.speed == 0.0


def test_failures_cost_time_unless_the_objective_changes_that() -> None:
    careful = Refiner(ROBOT, models(), failure_cost=20.0)
    assert careful.refine(world(), two_steps(BOTH)).chain.calls[0].goal.speed == 0.0
    fast = careful.refine(world(), two_steps(BOTH), Objective({"duration": 1.0}))
    assert fast.chain.calls[0].goal.speed > 0.3


def test_success_that_no_model_predicts_counts_only_by_default() -> None:
    prediction = SimpleNamespace(duration=np.array([2.0]))
    assert expected_time(30.0).cost(prediction) == [2.0]
    with pytest.raises(RefinementError, match="expected models that predict success"):
        Objective({"duration": 1.0, "success": 30.0}).cost(prediction)


@pytest.mark.parametrize(
    "weights",
    [
        {"speed": 1.0},
        {"duration": -1.0},
        {"duration": math.nan},
        {"duration": 0.0},
        {"success": math.inf},
    ],
)
def test_bad_weights_are_rejected(weights: dict[str, float]) -> None:
    with pytest.raises(RefinementError, match="objective: expected"):
        Objective(weights)


def test_absurd_lengths_are_rejected() -> None:
    with pytest.raises(
        RefinementError, match=f"expected 1 to {LONGEST_CHAIN} actions, got {LONGEST_CHAIN + 2}"
    ):
        Refiner(ROBOT, models()).refine(
            world(), TopChain(two_steps().calls * (LONGEST_CHAIN // 2 + 1))
        )


def test_predictions_that_are_not_numbers_are_rejected() -> None:
    broken = {"goToPose": FakeModel(lambda direct: math.nan * direct["yawg"], USED)}
    with pytest.raises(RefinementError, match="finite prediction"):
        Refiner(ROBOT, models() | broken).refine(world(), two_steps())


def test_a_chain_with_a_new_action_is_refined() -> None:
    top = dataclasses.replace(
        call("dribbleBall", 0.0, 0.0, 0.0).top, name="pushBall", action="push"
    )
    pushing = models() | {"push": FakeModel(lambda d: turning_time(d) * 2.0, USED)}
    first, last = two_steps().calls
    chain = TopChain((first, dataclasses.replace(last, top=top)))
    assert Refiner(ROBOT, pushing).refine(world(), chain).refined
