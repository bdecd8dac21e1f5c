"""The joint search against brute force.

The sampled search for subgoals with more than two free variables.
"""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refinement_fakes import StepCost, after, pair_by_pair

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.refinement.search import (
    BLOCK,
    NoCandidateError,
    Work,
    expected_work,
    least_path,
    search,
    spread_points,
)
from ator_ros.tops.ranges import Range

CIRCLE = Range(-math.pi, math.pi, 36, periodic=True)
SPEED = Range(0.0, 1.0, 6)


def smooth_cost(seed: int, sizes: list[int]) -> StepCost:
    """Return a cost with several valleys whose terms couple neighboring subgoals."""
    rng = np.random.default_rng(seed)
    before = [0, *sizes[:-1]]
    own = [rng.uniform(-math.pi, math.pi, size=k) for k in sizes]
    link = [rng.uniform(-1.0, 1.0, size=(j, k)) for j, k in zip(before, sizes, strict=True)]

    def cost(index: int, previous: FloatArray, values: FloatArray) -> FloatArray:
        total = (
            1.0
            - np.cos(values - own[index]).sum(axis=1)
            + 0.4 * np.cos(2.0 * values + 1.0).sum(axis=1)
        )
        for (j, k), weight in np.ndenumerate(link[index]):
            total = total + weight * np.sin(previous[:, j] - values[:, k])
        return np.asarray(total)

    return cost


def brute_force(cost: StepCost, axes: list[list[Range]], count: int) -> float:
    lines = [np.linspace(d.low, d.high, count) for domains in axes for d in domains]
    grid = np.array(list(itertools.product(*lines)))
    total, column, previous = np.zeros(len(grid)), 0, np.zeros((1, 0))
    for index, domains in enumerate(axes):
        values = grid[:, column : column + len(domains)]
        total = total + cost(index, previous, values if domains else np.zeros((1, 0)))
        column, previous = column + len(domains), values
    return float(total.min())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("axes", "count"),
    [
        ([[CIRCLE], []], 3601),
        ([[CIRCLE, SPEED], []], 401),
        ([[CIRCLE], [CIRCLE], []], 401),
        ([[CIRCLE], [CIRCLE], [CIRCLE]], 61),
        ([[CIRCLE, SPEED], [CIRCLE], []], 61),
    ],
)
def test_joint_search_is_as_good_as_brute_force(
    axes: list[list[Range]], count: int, seed: int
) -> None:
    cost = smooth_cost(seed, [len(domains) for domains in axes])
    optimum = search(pair_by_pair(cost), axes)
    assert optimum.cost <= brute_force(cost, axes, count) + 0.02


@pytest.mark.parametrize("axes", [[[CIRCLE], []], [[CIRCLE], [SPEED], [CIRCLE, SPEED]]])
def test_reported_cost_is_the_cost_of_the_values(axes: list[list[Range]]) -> None:
    cost = smooth_cost(3, [len(domains) for domains in axes])
    optimum = search(pair_by_pair(cost), axes)
    total, previous = 0.0, np.zeros((1, 0))
    for index, values in enumerate(optimum.values):
        total += float(cost(index, previous, values[None, :])[0])
        previous = values[None, :]
    assert optimum.cost == pytest.approx(total, abs=1e-12)


def test_curve_has_the_minimum_cost_through_each_candidate() -> None:
    axes = [[CIRCLE], [CIRCLE], []]
    cost = smooth_cost(1, [1, 1, 0])
    first, second, _ = search(pair_by_pair(cost), axes).curves
    others = second.values
    for value, total in zip(first.values, first.totals, strict=True):
        one = value[None, :]
        rest = cost(1, np.repeat(one, len(others), axis=0), others) + cost(
            2, others, np.zeros((1, 0))
        )
        assert total == pytest.approx(
            float(cost(0, np.zeros((1, 0)), one)[0] + rest.min()), abs=1e-12
        )


def test_given_values_are_never_made_worse() -> None:
    def needle(index: int, previous: FloatArray, values: FloatArray) -> FloatArray:
        return np.where(np.abs(wrap_angles(values[:, 0] - 0.123)) < 1e-9, 0.0, 1.0)

    assert search(pair_by_pair(needle), [[CIRCLE]], [np.array([0.123])]).cost == 0.0


def test_angles_may_lie_on_either_side_of_the_wrap_around() -> None:
    def cost(index: int, previous: FloatArray, values: FloatArray) -> FloatArray:
        speed = values[:, 1] if values.shape[1] else 0.0
        heading = values[:, 0] if values.shape[1] else 0.0
        return np.atleast_1d(1.0 - np.cos(heading - 3.13) + (speed - 0.77) ** 2)

    optimum = search(pair_by_pair(cost), [[CIRCLE, SPEED]])
    assert abs(float(wrap_angles(optimum.values[0][0] - 3.13))) < 0.05
    assert optimum.values[0][1] == pytest.approx(0.77, abs=0.05)
    assert -math.pi <= optimum.values[0][0] <= math.pi


LINE = Range(-2.0, 2.0, 20)
AXES = [[CIRCLE, LINE], [CIRCLE, LINE, LINE], []]
ASIDE = [np.array([-1.0, -1.5]), np.array([-1.0, -1.5, -1.0]), np.zeros(0)]
"""Values on the valley's floor, far from its minimum."""


def valley(shift: float) -> StepCost:
    """Return a cost with a curved valley that couples both subgoals; it is 0 at the valley's end.

    `shift` (rad) turns the valley, so that it may cross the wrap-around of angles.
    """

    def cost(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        if index == 0:
            return 0.0 * after[:, 0]
        first = np.asarray(wrap_angles(before[:, 0] - shift))
        if index == 2:
            return 0.5 * (first - 1.5) ** 2 + 0.5 * (before[:, 1] - 1.5) ** 2
        second = np.asarray(wrap_angles(after[:, 0] - shift))
        walls = np.asarray(wrap_angles(first - second)) ** 2 + (before[:, 1] - after[:, 1]) ** 2
        return np.asarray(30.0 * walls + 5.0 * (after[:, 2] - second) ** 2)

    return cost


def test_boxes_follow_a_valley() -> None:
    # The mean is 0.63 if boxes only shrink, 0.82 without wrap-around of angles, 0.79 with equal
    # points.
    costs = [search(pair_by_pair(valley(shift)), AXES).cost for shift in np.linspace(-3.0, 3.0, 20)]
    assert np.mean(costs) < 0.55


@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_given_angles_may_be_whole_turns_away(shift: float) -> None:
    near = [ASIDE[0] + [shift, 0.0], ASIDE[1] + [shift, 0.0, 0.0], ASIDE[2]]
    far = [near[0] + [4.0 * math.pi, 0.0], near[1] - [6.0 * math.pi, 0.0, 0.0], near[2]]
    costs = pair_by_pair(valley(shift))
    found, again = search(costs, AXES, near), search(costs, AXES, far)
    assert again.cost == pytest.approx(found.cost, abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(1, 5), min_size=1, max_size=5), st.integers(0, 1000))
def test_the_best_path_through_candidates_is_found_exactly(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    candidates = [np.arange(size, dtype=float)[:, None] for size in sizes]
    tables = [rng.random((n, m)) for n, m in itertools.pairwise([1, *sizes])]

    def costs(steps: list[tuple[int, FloatArray, FloatArray]]) -> list[FloatArray]:
        return [
            tables[index][before[:, 0, 0].astype(int)] if index else tables[0]
            for index, before, _ in steps
        ]

    found = least_path(costs, candidates)  # type: ignore[arg-type]
    totals = {}
    for path in itertools.product(*map(range, sizes)):
        steps = itertools.pairwise((0, *path))
        totals[path] = sum(tables[index][step] for index, step in enumerate(steps))
    assert found.cost == pytest.approx(min(totals.values()))
    assert totals[tuple(found.rows)] == pytest.approx(found.cost)
    assert [value[0] for value in found.values] == list(found.rows)
    assert found.complete
    for subgoal, curve in enumerate(found.curves):
        for row, total in enumerate(curve.totals):
            through = [cost for path, cost in totals.items() if path[subgoal] == row]
            assert total == pytest.approx(min(through))


def test_pairs_are_evaluated_in_blocks() -> None:
    sizes = []

    def costs(steps: list[tuple[int, FloatArray, FloatArray]]) -> list[FloatArray]:
        sizes.append(sum(len(before) * len(there) for _, before, there in steps))
        return [np.zeros((len(before), len(there))) for _, before, there in steps]

    candidates = [np.zeros((size, 1)) for size in (30, 40, 5, 5, 700, 2)]
    least_path(costs, candidates)  # type: ignore[arg-type]
    assert sum(sizes) == 30 + 30 * 40 + 40 * 5 + 25 + 5 * 700 + 700 * 2
    assert max(size for size in sizes if size != 700) <= BLOCK
    assert len(sizes) < 20


def test_after_the_deadline_later_subgoals_keep_their_first_candidate() -> None:
    cost = pair_by_pair(lambda index, _, there: -(1.0 + index) * there[:, 0])
    candidates = [np.arange(400.0)[:, None], np.arange(400.0)[:, None], np.arange(3.0)[:, None]]
    late = least_path(cost, candidates, after(1))
    assert [float(value[0]) for value in late.values] == [399.0, 0.0, 0.0]
    assert not late.complete
    assert late.cost == -399.0
    assert [len(curve.values) for curve in late.curves] == [400, 1, 1]
    assert least_path(cost, candidates, after(10**6)).complete


def flat(index: int, before: FloatArray, there: FloatArray) -> FloatArray:
    return np.ones(len(there))


@pytest.mark.parametrize(
    "axes",
    [
        [[CIRCLE]],
        [[CIRCLE], []],
        [[CIRCLE, SPEED], [CIRCLE, SPEED], []],
        [[CIRCLE, SPEED, SPEED], [], [CIRCLE, SPEED, SPEED, SPEED]],
        [[CIRCLE]] * 12,
    ],
)
@pytest.mark.parametrize("cost", [flat, None])
def test_the_work_is_estimated_and_rather_too_large(
    axes: list[list[Range]], cost: StepCost | None
) -> None:
    costs = cost or smooth_cost(1, [len(domains) for domains in axes])
    work = Work(expected=expected_work(axes))
    search(pair_by_pair(costs), axes, work=work)
    assert 0.1 * work.expected < work.done <= work.expected


def test_without_free_variables_one_path_is_evaluated() -> None:
    work = Work()
    found = search(pair_by_pair(flat), [[], []], [np.zeros(0), np.zeros(0)], work=work)
    assert (found.cost, found.complete, found.searched) == (2.0, True, False)
    assert work.done <= expected_work([[], []]) < 200.0


def test_candidates_stay_in_their_ranges_and_regions() -> None:
    ranges = [CIRCLE, SPEED, Range(-2.0, -1.0, 5)]
    seen: list[FloatArray] = []

    def cost(index: int, before: FloatArray, there: FloatArray) -> FloatArray:
        seen.append(there)
        return np.asarray(there[:, 2] - there[:, 1] + np.cos(there[:, 0]))

    def allowed(index: int, values: FloatArray) -> FloatArray:
        return np.asarray(values[:, 1] <= 0.5)  # type: ignore[return-value]

    for region in (None, allowed):
        seen.clear()
        found = search(pair_by_pair(cost), [ranges], allowed=region)  # type: ignore[arg-type]
        values = np.concatenate(seen)
        for column, each in zip(values.T, ranges, strict=True):
            assert each.low <= column.min() <= column.max() <= each.high
        assert bool(values[:, 1].max() <= 0.5) is (region is not None)
        expected = [-math.pi, 0.5 if region else 1.0, -2.0]
        error = np.abs(found.values[0] - expected)
        assert min(error[0], 2.0 * math.pi - error[0]) < 0.05
        assert error[1:].max() < 0.05


def test_a_region_without_a_point_has_no_candidate() -> None:
    def nowhere(index: int, values: FloatArray) -> FloatArray:
        return np.zeros(len(values), dtype=bool)  # type: ignore[return-value]

    with pytest.raises(NoCandidateError):
        search(pair_by_pair(flat), [[CIRCLE]], allowed=nowhere)  # type: ignore[arg-type]
    given = [np.array([0.3])]
    found = search(pair_by_pair(flat), [[CIRCLE]], given, allowed=nowhere)  # type: ignore[arg-type]
    assert found.values[0] == [0.3]


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 100), st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_the_result_is_never_above_the_given_values_and_always_the_same(
    seed: int, given: list[float]
) -> None:
    axes = [[CIRCLE], [CIRCLE], [CIRCLE]]
    cost = smooth_cost(seed, [1, 1, 1])
    values = [np.array([value]) for value in given]
    first = search(pair_by_pair(cost), axes, values)
    pairs = itertools.pairwise([np.zeros((1, 0)), *(value[None] for value in values)])
    sent = sum(float(cost(index, *pair)[0]) for index, pair in enumerate(pairs))
    assert first.cost <= sent + 1e-12
    assert search(pair_by_pair(cost), axes, values).cost == first.cost


@pytest.mark.parametrize("shift", [0.5, 2.0])
def test_the_search_follows_a_turned_cost(shift: float) -> None:
    cost = smooth_cost(4, [1, 1])

    def turned(index: int, before: FloatArray, there: FloatArray) -> FloatArray:
        return cost(index, before - shift, there - shift)

    usual = search(pair_by_pair(cost), [[CIRCLE], [CIRCLE]])
    again = search(pair_by_pair(turned), [[CIRCLE], [CIRCLE]])
    assert again.cost == pytest.approx(usual.cost, abs=1e-3)


@pytest.mark.parametrize("least", [0.013, 0.61])
def test_a_narrow_valley_is_followed_to_its_floor(least: float) -> None:
    def cost(index: int, before: FloatArray, there: FloatArray) -> FloatArray:
        return np.asarray(np.abs(there[:, 1] - least) + 1.0 - np.cos(there[:, 0] - 3.0 * least))

    found = search(pair_by_pair(cost), [[CIRCLE, SPEED]])
    assert found.cost < 0.003


@pytest.mark.parametrize("dimensions", [1, 2, 5])
def test_points_are_spread_evenly(dimensions: int) -> None:
    points = spread_points(dimensions, 0, 1024)
    assert points.shape == (1024, dimensions)
    assert 0.0 <= points.min() < 0.01 < 0.99 < points.max() < 1.0
    for column in points.T:
        counts, _ = np.histogram(column, bins=16, range=(0.0, 1.0))
        assert counts.min() > 58
        assert counts.max() < 70
    assert (spread_points(dimensions, 10, 5) == points[10:15]).all()


def test_a_small_region_has_as_many_first_candidates_as_a_whole_range() -> None:
    def narrow(index: int, values: FloatArray) -> FloatArray:
        return np.asarray(np.abs(values[:, 0] - 1.0) < 0.3)  # type: ignore[return-value]

    whole = search(pair_by_pair(flat), [[CIRCLE]]).curves[0]
    part = search(pair_by_pair(flat), [[CIRCLE]], allowed=narrow).curves[0]  # type: ignore[arg-type]
    assert len(part.values) == len(whole.values)
    assert np.ptp(part.values) > 0.5
