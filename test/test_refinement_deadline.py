"""Refinement in slices: nothing changes while there is time, and what there is when time is up is used."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
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

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import FloatArray
from ator_ros.performance.model_file import load_models
from ator_ros.refinement import paths as paths_module
from ator_ros.refinement.answer import Refinement
from ator_ros.refinement.chain_model import REPORTED, predict_chain
from ator_ros.refinement.paths import BLOCK
from ator_ros.refinement.projection import chain_situations
from ator_ros.refinement.refiner import LONGEST_CHAIN, Refiner
from ator_ros.refinement.search import search, searching
from ator_ros.refinement.slices import Result, Slices
from ator_ros.tops.chain import TopChain
from ator_ros.tops.ranges import Range

CIRCLE = Range(-math.pi, math.pi, 36, periodic=True)
SPEED = Range(0.0, 1.0, 6)
AXES = [[CIRCLE, SPEED], [CIRCLE, SPEED], [CIRCLE], []]
GIVEN = [np.array([1.0, 0.5]), np.array([-2.0, 0.1]), np.array([0.3]), np.zeros(0)]


def waves(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return a cost with several valleys that couples neighbouring subgoals."""
    own = np.cos(3.0 * after + index).sum(axis=1)
    return np.asarray(2.0 + own + np.sin(before.sum(axis=1) - after.sum(axis=1)))


def cost_of(values: list[FloatArray] | tuple[FloatArray, ...]) -> float:
    pairs = zip([np.zeros(0), *values], values, strict=False)
    return sum(float(waves(i, a[None, :], b[None, :])[0]) for i, (a, b) in enumerate(pairs))


def driven(work: Slices[Result], in_time: int) -> tuple[Result, int]:
    """Let time be up after `in_time` slices; give the result and how many slices there were."""
    slices = 0
    try:
        next(work)
        while True:
            work.send(slices >= in_time)
            slices += 1
    except StopIteration as end:
        return end.value, slices


class CountingModel(FakeModel):
    """Counts how often it is asked."""

    asked = 0

    def predict(self, direct: Mapping[str, Any], measures: tuple[str, ...] = ("duration",)) -> Any:
        self.asked += 1
        return super().predict(direct, measures)


def counting_models() -> dict[str, CountingModel]:
    return {name: CountingModel(turning_time, USED) for name in ("goToPose", "dribbleBall")}


def asked_after(in_time: int, *, placeholders: bool) -> tuple[Refinement, int]:
    """Let time be up after `in_time` slices; give the result and how often models were asked from then on."""
    counted = counting_models()
    work = Refiner(ROBOT, counted).refining(world(), long_chain(), placeholders=placeholders)
    slices, before = 0, 0
    try:
        next(work)
        while True:
            if slices == in_time:
                before = sum(model.asked for model in counted.values())
            work.send(slices >= in_time)
            slices += 1
    except StopIteration as end:
        return end.value, sum(model.asked for model in counted.values()) - before


def long_chain() -> TopChain:
    steps = (call("goToBall", 0.0, 0.0, 0.0, ANGLE), call("dribbleBall", -2.0, 1.0, 0.0, BOTH))
    return TopChain(steps * (LONGEST_CHAIN // 2))


def test_blocks_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paths_module, "BLOCK", 10**9)
    whole = search(waves, AXES, GIVEN)
    monkeypatch.setattr(paths_module, "BLOCK", 7)
    parts = search(waves, AXES, GIVEN)
    assert whole.cost == parts.cost
    for one, other in zip(whole.curves, parts.curves, strict=True):
        assert one.totals.tobytes() == other.totals.tobytes()


def test_no_slice_is_long() -> None:
    rows: list[int] = []

    def counted(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        rows.append(max(len(before), len(after)))
        return waves(index, before, after)

    _, slices = driven(searching(counted, AXES, GIVEN), 10**9)
    assert max(rows) <= BLOCK < sum(rows)
    assert slices >= len(rows)


def test_time_may_be_up_at_any_slice() -> None:
    full, slices = driven(searching(waves, AXES, GIVEN), 10**9)
    assert full.complete
    costs = []
    for in_time in range(slices):
        optimum, taken = driven(searching(waves, AXES, GIVEN), in_time)
        assert optimum.cost == pytest.approx(cost_of(optimum.values), abs=1e-12)
        assert optimum.cost <= cost_of(GIVEN) + 1e-12
        assert taken - in_time <= 4 * len(AXES)
        costs.append(optimum.cost)
        if not optimum.complete:
            assert all(len(curve.values) == len(curve.totals) for curve in optimum.curves)
    assert costs[0] == pytest.approx(cost_of(GIVEN))
    costs.append(full.cost)
    assert sorted(costs, reverse=True) == pytest.approx(costs)  # the more time, the better


def test_a_search_without_given_values_ends_its_first_pass() -> None:
    optimum, _ = driven(searching(waves, AXES), 0)
    assert not optimum.complete
    assert optimum.cost == pytest.approx(min(optimum.curves[0].totals))


def outcomes(chain: TopChain, *, placeholders: bool = False) -> Iterator[Refinement]:
    refiner = Refiner(ROBOT, models())
    _, slices = driven(refiner.refining(world(), chain, placeholders=placeholders), 10**9)
    for in_time in range(0, slices, max(1, slices // 40)):
        yield driven(refiner.refining(world(), chain, placeholders=placeholders), in_time)[0]


def test_the_answer_says_that_it_was_cut_short_and_is_never_worse() -> None:
    results = list(outcomes(long_chain()))
    for result in results:
        assert result.before is not None
        assert result.after is not None
        assert result.after.cost <= result.before.cost
        assert result.complete == ("deadline" not in result.reason)
    assert not results[0].complete
    assert results[0].best == long_chain()
    assert any(result.refined and not result.complete for result in results)


def test_placeholders_that_nobody_had_time_for_are_as_sent() -> None:
    sent = three_steps(BOTH)
    first, *_, last = outcomes(sent, placeholders=True)
    assert first.original == sent  # its speeds are 0, the value at rest
    assert not first.complete
    assert last.original == Refiner(ROBOT, models()).naive(world(), sent) != sent


def test_a_chain_that_is_answered_in_time_is_the_one_of_refine() -> None:
    refiner, chain = Refiner(ROBOT, models()), three_steps(BOTH)
    result, _ = driven(refiner.refining(world(), chain), 10**9)
    assert result.complete
    assert result.best == refiner.refine(world(), chain).best


@pytest.mark.parametrize("placeholders", [False, True])
def test_a_chain_that_nobody_had_time_for_is_answered_as_given_at_little_cost(placeholders: bool) -> None:
    result, asked = asked_after(0, placeholders=placeholders)
    assert asked == 2  # once for each action, though the chain has 32 steps
    assert result.chain == result.best == long_chain()
    assert (result.refined, result.complete) == (False, False)
    assert "deadline" in result.reason
    whole = Refiner(ROBOT, models()).refine(world(), long_chain())
    assert result.before == result.after == whole.before


@pytest.mark.parametrize("in_time", [1, 10, 40, 70, 100, 150])
def test_little_is_left_to_do_when_time_is_up(in_time: int) -> None:
    result, asked = asked_after(in_time, placeholders=False)
    assert not result.complete
    # One step from what was found to what was given, each action once as given, what is on the path.
    assert asked <= 6


def test_steps_that_are_predicted_together_are_predicted_the_same_to_the_last_bit() -> None:
    learned, chain = load_models(ROBOT, SOCCER.known_features), long_chain()
    together = predict_chain(world(), chain, learned, ROBOT)
    for direct, step, told in zip(
        chain_situations(world(), chain, ROBOT), chain.calls, together.actions, strict=True
    ):
        alone = learned[step.top.action].predict(direct, REPORTED)
        assert told == {name: float(getattr(alone, name)[0]) for name in told}
