"""The sampled search, for subgoals with more than two free variables."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.refinement.search import StepCost, search
from ator_ros.tops.ranges import Range

CIRCLE = Range(-math.pi, math.pi, 36, periodic=True)
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
    # The mean is 0.63 if boxes only shrink, 0.82 without wrap-around of angles, 0.79 with equal points.
    costs = [search(valley(shift), AXES).cost for shift in np.linspace(-3.0, 3.0, 20)]
    assert np.mean(costs) < 0.55


@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_given_angles_may_be_whole_turns_away(shift: float) -> None:
    near = [ASIDE[0] + [shift, 0.0], ASIDE[1] + [shift, 0.0, 0.0], ASIDE[2]]
    far = [near[0] + [4.0 * math.pi, 0.0], near[1] - [6.0 * math.pi, 0.0, 0.0], near[2]]
    found, again = search(valley(shift), AXES, near), search(valley(shift), AXES, far)
    assert again.cost == pytest.approx(found.cost, abs=1e-6)
