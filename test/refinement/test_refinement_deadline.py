"""The deadline of a refinement: once it has passed, the answer is the best chain found."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from refinement_fakes import (
    ANGLE,
    BOTH,
    LIBRARY,
    ROBOT,
    USED,
    FakeModel,
    after,
    call,
    models,
    pair_by_pair,
    three_steps,
    turning_time,
    world,
)

from ator_ros.geometry import FloatArray
from ator_ros.refinement.naive import naive_on_paths
from ator_ros.refinement.refiner import ITS_DEADLINE, LONGEST_CHAIN, Refiner, Selection
from ator_ros.refinement.search import search
from ator_ros.tops.chain import TopChain
from ator_ros.tops.ranges import Range

CIRCLE = Range(-math.pi, math.pi, 36, periodic=True)
SPEED = Range(0.0, 1.0, 6)
AXES = [[CIRCLE, SPEED], [CIRCLE, SPEED], [CIRCLE], []]
GIVEN = [np.array([1.0, 0.5]), np.array([-2.0, 0.1]), np.array([0.3]), np.zeros(0)]


def waves(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return a cost with several valleys that couples neighboring subgoals."""
    own = np.cos(3.0 * after + index).sum(axis=1)
    return np.asarray(2.0 + own + np.sin(before.sum(axis=1) - after.sum(axis=1)))


def cost_of(values: list[FloatArray] | tuple[FloatArray, ...]) -> float:
    pairs = zip([np.zeros(0), *values], values, strict=False)
    return sum(float(waves(i, a[None, :], b[None, :])[0]) for i, (a, b) in enumerate(pairs))


class CountingModel(FakeModel):
    """Counts its predictions."""

    predictions = 0

    def predict(
        self, direct: Mapping[str, Any], measures: tuple[str, ...] = (), signs: Any = None
    ) -> Any:
        self.predictions += 1
        return super().predict(direct, measures, signs)


def long_chain() -> TopChain:
    steps = (call("goToBall", 0.0, 0.0, 0.0, ANGLE), call("dribbleBall", -2.0, 1.0, 0.0, BOTH))
    return TopChain(steps * (LONGEST_CHAIN // 2))


def test_more_time_gives_a_lower_cost() -> None:
    full = search(pair_by_pair(waves), AXES, GIVEN)
    assert full.complete
    costs = []
    for checks in range(200):
        optimum = search(pair_by_pair(waves), AXES, GIVEN, deadline=after(checks))
        assert optimum.cost == pytest.approx(cost_of(optimum.values), abs=1e-12)
        assert optimum.cost <= cost_of(GIVEN) + 1e-12
        costs.append(optimum.cost)
        if optimum.complete:
            break
        assert all(len(curve.values) == len(curve.totals) for curve in optimum.curves)
    assert costs[0] == pytest.approx(cost_of(GIVEN))
    assert costs[-1] == full.cost
    assert sorted(costs, reverse=True) == pytest.approx(costs)


def test_an_answer_at_the_deadline_is_marked_and_never_worse() -> None:
    refiner = Refiner(ROBOT, models())
    results = [
        refiner.refine(world(), long_chain(), deadline=after(checks))
        for checks in range(0, 300, 12)
    ]
    for result in results:
        assert result.after.cost <= result.before.cost
        assert result.complete == (ITS_DEADLINE not in result.reason)
    assert not results[0].complete
    assert results[0].best == long_chain()
    assert any(result.refined and not result.complete for result in results)


def test_placeholders_have_naive_values_without_time() -> None:
    sent, refiner = three_steps(BOTH), Refiner(ROBOT, models())
    first = refiner.refine(world(), sent, placeholders=True, deadline=after(0))
    assert first.original == naive_on_paths(world(), sent, ROBOT, LIBRARY.ranges) != sent
    assert not first.complete
    assert first.reason == "kept naive without a search, as its deadline had passed"
    again = refiner.refine(world(), first.original, deadline=after(0))
    assert again.reason == "kept as sent without a search, as its deadline had passed"
    whole = refiner.refine(world(), sent, placeholders=True)
    assert whole.original == refiner.naive(world(), sent) != sent


@pytest.mark.parametrize("placeholders", [False, True])
def test_without_time_a_long_chain_is_answered_as_given_with_few_predictions(
    placeholders: bool,
) -> None:
    counted = {name: CountingModel(turning_time, USED) for name in ("goToPose", "dribbleBall")}
    refiner = Refiner(ROBOT, counted)
    result = refiner.refine(world(), long_chain(), placeholders=placeholders, deadline=after(0))
    # once for each action of 32 steps
    assert sum(model.predictions for model in counted.values()) == 2
    sent = long_chain()
    if placeholders:
        sent = naive_on_paths(world(), sent, ROBOT, refiner.ranges)
    assert result.chain == result.best == sent
    assert (result.refined, result.complete) == (False, False)
    whole = Refiner(ROBOT, models()).refine(world(), sent)
    assert result.before == result.after == whole.before


class Clock:
    """A clock that counts the evaluated pairs of candidates, and its deadline."""

    def __init__(self, seconds: float = math.inf) -> None:
        self.time, self._seconds = 0.0, seconds

    def deadline(self) -> bool:
        return self.time > self._seconds

    def models(self) -> dict[str, FakeModel]:
        def timed(direct: Mapping[str, Any]) -> Any:
            duration = turning_time(direct)
            self.time += 40 + np.size(duration)
            return duration

        return dict.fromkeys(("goToPose", "dribbleBall"), FakeModel(timed, USED))


@pytest.mark.parametrize("steps", [4, 12, LONGEST_CHAIN])
@pytest.mark.parametrize("share", [0.3, 0.7])
def test_the_deadline_that_a_search_needs_is_estimated(steps: int, share: float) -> None:
    chain = TopChain(long_chain().calls[:steps])
    whole = Clock()
    Refiner(ROBOT, whole.models()).refine(world(), chain, placeholders=True)
    part = Clock(share * whole.time)
    refiner = Refiner(ROBOT, part.models())
    answer = refiner.refine(world(), chain, placeholders=True, deadline=part.deadline)
    found = Selection((answer,), 0, answer)
    assert not found.complete
    needed = share * whole.time / found.share_done
    assert 0.5 * whole.time < needed < 2.0 * whole.time
