"""The joint search against brute force.

The sampled search for subgoals with more than two free variables.
"""

import itertools
import math

import numpy as np
import pytest
from refinement_fakes import StepCost, pair_by_pair

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.refinement.search import search
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
