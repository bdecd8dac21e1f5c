"""Which tree replaces the one in use: small cases by hand, and the rate of wrong decisions."""

import re

import numpy as np
import pandas as pd
import pytest

from ator_ros.geometry import FloatArray
from ator_ros.learning.judging import RoundVerdict, constant_tree, judge
from ator_ros.performance.prior import Slope
from ator_ros.performance.training import Examples
from ator_ros.performance.tree.model_tree import ModelTreeRegressor
from ator_ros.performance.tree.nodes import ModelTree

NAMES = ("dist",)


def examples(
    values: FloatArray, *, dist: FloatArray | None = None, measure: str = "duration"
) -> Examples:
    count = len(values)
    known = np.linspace(0.0, 3.0, count) if dist is None else dist
    table = pd.DataFrame({"dist": known})
    found = np.asarray(values, dtype=float)
    return Examples(measure, np.arange(count), table, found, None, {"dist": Slope(2.0, 0.6)})


def line(intercept: float, slope: float) -> ModelTree:
    """Return a tree that predicts intercept + slope*dist from 0 to 10 m."""
    table = pd.DataFrame({"dist": np.linspace(0.0, 10.0, 400)})
    target = intercept + slope * table["dist"].to_numpy()
    tree: ModelTree = ModelTreeRegressor(max_leaves=1).fit(table, target).tree_
    return tree


def constant(value: float) -> ModelTree:
    return constant_tree(pd.DataFrame({"dist": [0.0, 1.0]}), np.array([value, value]))


def uniform(count: int, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).uniform(0.0, 3.0, count)


def noise(count: int, seed: int = 2) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, 0.05, count)


def decided(found: Examples, current: ModelTree | None, **options: object) -> RoundVerdict:
    given = {"new": len(found.values), "former": {}, **options}
    return judge(found, NAMES, current=current, **given)


def losses(reason: str) -> list[float]:
    found = re.search(r"from ([\d.e-]+) to ([\d.e-]+)", reason)
    assert found is not None, reason
    return [float(each) for each in found.groups()]


def test_a_constant_tree_predicts_the_mean() -> None:
    table = pd.DataFrame({"dist": [0.0, 1.0, 5.0]})
    tree = constant_tree(table, np.array([1.0, 2.0, 6.0]))
    assert tree.predict(np.array([[-9.0], [9.0]])) == pytest.approx([3.0, 3.0])


def test_a_clearly_better_tree_replaces_the_one_in_use() -> None:
    dist = uniform(60)
    found = examples(1.0 + dist + noise(60), dist=dist, measure="accuracy")
    verdict = decided(found, constant(1.0))
    assert verdict.kind == "learned from 60 episodes"
    assert verdict.reason.startswith(f"{verdict.kind}: error from ")
    assert verdict.reason.endswith(" m on 50 records")
    assert verdict.episodes == 60
    assert verdict.tree is not None
    assert verdict.tree.predict(np.array([[1.5]])) == pytest.approx(2.5, abs=0.1)
    old, new = losses(verdict.reason)
    assert old == pytest.approx(np.mean(dist[10:] + noise(60)[10:]), rel=0.01)
    assert verdict.errors is not None
    assert new == pytest.approx(np.mean(np.abs(verdict.errors)), rel=0.01)


def test_a_good_tree_is_kept() -> None:
    dist = uniform(80)
    verdict = decided(examples(1.0 + dist + noise(80), dist=dist), line(1.0, 1.0))
    assert (verdict.kind, verdict.tree, verdict.errors) == ("", None, None)
    assert verdict.reason.startswith("no better: ")
    old, new = losses(verdict.reason)
    assert new > 0.9 * old


def test_of_values_that_depend_on_nothing_hardly_any_tree_is_replaced() -> None:
    switched = 0
    for seed in range(20):
        values = 1.0 + np.random.default_rng(seed).normal(0.0, 0.3, 40)
        found = examples(values, dist=uniform(40, seed), measure="accuracy")
        switched += bool(decided(found, constant(1.0)).kind)
    assert switched <= 3  # the level is 5 %; more than 3 have a probability of 1.6 %


def test_candidates_are_not_tested_on_what_they_learned() -> None:
    """Half of the records have another value, at random: a tree that has seen them would know."""
    rng = np.random.default_rng(5)
    values = 10.0 * rng.integers(0, 2, 60)
    verdict = decided(examples(values, dist=uniform(60), measure="accuracy"), constant(40.0))
    assert verdict.errors is not None
    assert np.mean(np.abs(verdict.errors)) > 4.0


@pytest.mark.parametrize(("measure", "which"), [("duration", " that succeeded"), ("success", "")])
def test_a_tree_is_judged_by_at_least_12_new_records(measure: str, which: str) -> None:
    found = examples(np.full(40, 0.5), measure=measure)
    few = decided(found, constant(0.9), new=11)
    assert few.reason == f"too few new records: 11, expected 12{which}"
    assert (few.episodes, few.kind) == (40, "")
    assert decided(found, constant(0.9), new=12).kind


@pytest.mark.parametrize(("new", "tested"), [(12, 12), (50, 50), (90, 50)])
def test_durations_are_compared_on_the_newest_50_new_records(new: int, tested: int) -> None:
    values = np.where(np.arange(100) < 100 - tested, 1.0, 2.0)
    verdict = decided(examples(values), constant(2.0), new=new, former={"first": constant(1.0)})
    assert verdict.kind == ""
    assert losses(verdict.reason)[0] == 0.0
    assert verdict.reason.endswith(f"on {tested} records (chance 1.000)")
    better = decided(examples(values), constant(1.0), new=new)
    assert better.tested is not None
    assert better.tested.tolist() == list(range(100 - tested, 100))
    assert losses(better.reason)[0] == pytest.approx(1.0)


def test_the_tree_in_use_is_no_former_one() -> None:
    dist = uniform(60)
    found = examples(1.0 + dist + noise(60), dist=dist)
    verdict = decided(found, line(1.0, 1.0), former={"set 000001": line(1.0, 1.0)})
    assert "back to" not in verdict.reason


def test_too_few_records_to_learn_from_are_reported() -> None:
    for count, others in ((25, 16), (13, 8)):
        verdict = decided(examples(np.ones(count), measure="accuracy"), constant(0.0))
        expected = f"too few records: {others} without those that are predicted, expected 20"
        assert (verdict.reason, verdict.episodes) == (expected, count)


def test_the_first_tree_of_durations_is_learned_from_twenty_records() -> None:
    dist = uniform(20)
    assert decided(examples(1.0 + dist, dist=dist), None).kind == "learned from 20 episodes"
    few = decided(examples(1.0 + dist[:19], dist=dist[:19]), None)
    assert few.reason == "too few records: 12 without those that are predicted, expected 13"


def test_without_a_tree_the_mean_is_the_baseline() -> None:
    dist = uniform(60)
    learned = decided(examples(1.0 + dist, dist=dist, measure="accuracy"), None)
    assert learned.kind == "learned from 60 episodes"
    assert losses(learned.reason)[0] == pytest.approx(np.mean(np.abs(dist - dist.mean())), rel=0.1)
    assert not decided(examples(1.0 + noise(60), dist=dist, measure="accuracy"), None).kind


# Scaled trees


@pytest.mark.parametrize(("slope", "shift"), [(1.0, 0.5), (1.5, 0.0), (2.0, -0.4), (0.5, 0.3)])
def test_a_tree_is_scaled_and_shifted_to_a_dozen_records(slope: float, shift: float) -> None:
    dist = uniform(24)
    values = slope * (1.0 + dist) + shift
    values[[3, 11, 17]] += 40.0  # accidents
    verdict = decided(examples(values, dist=dist), line(1.0, 1.0))
    assert verdict.kind == "the present model scaled to 30 episodes"
    assert verdict.tree is not None
    there = np.array([[0.0], [1.0], [3.0]])
    expected = slope * (1.0 + there[:, 0]) + shift
    assert verdict.tree.predict(there) == pytest.approx(expected, abs=0.02)


def test_a_slope_beyond_that_of_a_changed_robot_is_limited() -> None:
    dist = uniform(24)
    for slope, limited in ((20.0, 3.0), (0.01, 0.3)):
        verdict = decided(examples(slope * (1.0 + dist), dist=dist), line(1.0, 1.0))
        assert verdict.tree is not None
        near, far = verdict.tree.predict(np.array([[0.0], [2.0]]))
        assert far - near == pytest.approx(2.0 * limited, rel=1e-6)


def test_only_the_newest_30_records_scale_a_tree() -> None:
    dist = uniform(105)
    factor = np.where(np.arange(105) < 60, 1.0, 2.0)
    verdict = decided(examples(factor * (1.0 + dist), dist=dist), line(1.0, 1.0))
    assert verdict.kind == "the present model scaled to 30 episodes"
    assert verdict.tree is not None
    assert verdict.tree.predict(np.array([[1.0]])) == pytest.approx(4.0, abs=0.01)


def test_the_spread_of_a_new_tree_is_that_of_its_errors() -> None:
    dist = uniform(40)
    values = 1.5 * (1.0 + dist) + 6.0 * noise(40)
    verdict = decided(examples(values, dist=dist), line(1.0, 1.0), new=24)
    assert verdict.tree is not None
    assert verdict.errors is not None
    expected = 1.4826 * np.median(np.abs(verdict.errors))
    assert np.median(verdict.tree.spread) == pytest.approx(expected)
    assert 0.15 < expected < 0.6


def test_a_tree_without_spread_gets_that_of_its_errors() -> None:
    values = 4.0 + np.resize([-0.1, 0.1], 24)
    verdict = decided(examples(values), constant(1.0), new=24)
    assert verdict.tree is not None
    assert verdict.errors is not None
    assert verdict.tree.spread == pytest.approx(1.4826 * np.median(np.abs(verdict.errors)))


# Former trees


def test_a_former_tree_that_is_as_good_as_others_is_used_as_it_is() -> None:
    dist = uniform(60)
    former = {"the models of the start": line(1.0, 1.0)}
    found = examples(1.0 + dist + noise(60), dist=dist)
    verdict = decided(found, line(1.3, 1.3), new=30, former=former)
    assert verdict.kind == "back to the models of the start"
    assert verdict.tree is not None
    there = np.array([[0.0], [2.0]])
    assert verdict.tree.predict(there) == pytest.approx([1.0, 3.0], abs=1e-4)


def test_many_equal_candidates_count_like_one() -> None:
    values = 1.0 + np.random.default_rng(4).normal(0.0, 0.3, 19)
    found = examples(values)
    chances = []
    for names in ("a", "abc"):
        former = {name: constant(1.05) for name in names}
        reason = decided(found, constant(1.0), former=former).reason
        chances += re.findall(r"chance ([\d.]+)", reason)
    assert len(chances) == 2
    assert chances[0] == chances[1]


# Success


def test_failures_of_one_kind_are_learned_and_others_are_a_rate() -> None:
    dist = uniform(120)
    rng = np.random.default_rng(7)
    of_far_goals = examples((dist < 2.0).astype(float), dist=dist, measure="success")
    verdict = decided(of_far_goals, constant(1.0))
    assert verdict.kind == "learned from 120 episodes"
    assert "Brier score from" in verdict.reason
    assert losses(verdict.reason)[0] == pytest.approx(np.mean(dist >= 2.0), rel=0.01)
    at_random = examples((rng.random(120) < 0.7).astype(float), dist=dist, measure="success")
    verdict = decided(at_random, constant(1.0))
    assert verdict.kind == "the rate of 120 episodes"
    assert verdict.tree is not None
    assert verdict.tree.constant == pytest.approx(at_random.values.mean())


def test_two_hundred_of_many_records_are_a_window_of_their_own() -> None:
    values = np.append(np.ones(400), np.zeros(200))
    verdict = decided(examples(values, dist=uniform(600), measure="success"), constant(1.0))
    assert verdict.kind == "the rate of 200 episodes"
    assert verdict.tree is not None
    assert verdict.tree.constant == 0.0


def test_failures_that_are_avoided_are_not_forgotten() -> None:
    """Only the oldest 60 of the newest 300 records failed; no later one is from there."""
    dist = uniform(120)
    found = examples((dist < 2.0).astype(float), dist=dist, measure="success")
    current = decided(found, None).tree
    assert current is not None
    later = np.append(np.full(60, 2.5), uniform(240) * 0.5)
    values = np.append(np.zeros(60), np.ones(240))
    verdict = decided(examples(values, dist=later, measure="success"), current, new=30)
    assert "on 300 records" in verdict.reason
    used = verdict.tree or current
    assert used.predict(np.array([[2.5]]))[0] < 0.2
    assert used.predict(np.array([[0.5]]))[0] > 0.9
