"""Averages of costs over neighboring candidates make the choice robust to single errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ator_ros.geometry import FloatArray, wrap_angles
from ator_ros.refinement.search import Averages, search
from ator_ros.tops.ranges import Range

CIRCLE = Range(-math.pi, math.pi, 36, periodic=True)
WIDTH = math.radians(8.0)


def dip_and_valley(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return a cost with a deep dip 4 degrees wide at 2.0 rad, and a broad valley at -1.0 rad."""
    yaw = after[:, 0]
    dip = np.abs(wrap_angles(yaw - 2.0)) < math.radians(2.0)
    valley = np.exp(-(wrap_angles(yaw + 1.0) ** 2))
    return np.asarray(5.0 - valley - 1.5 * dip)


def test_a_narrow_dip_among_high_costs_is_not_chosen() -> None:
    given = [np.array([0.0])]
    followed = search(dip_and_valley, [[CIRCLE]], given)
    assert followed.values[0][0] == pytest.approx(2.0, abs=math.radians(2.0))
    averages = Averages([[CIRCLE]], [[WIDTH]])
    careful = search(dip_and_valley, [[CIRCLE]], given, averages=averages)
    assert careful.values[0][0] == pytest.approx(-1.0, abs=math.radians(3.0))
    assert careful.given_cost == pytest.approx(5.0 - math.exp(-1.0), abs=0.05)
    assert followed.given_cost is None


def test_a_choice_is_not_worse_beside_a_step() -> None:
    """Beside a step of the cost, the mean alone would choose a candidate with a higher cost."""

    def step(index: int, before: FloatArray, after: FloatArray) -> FloatArray:
        yaw = after[:, 0]
        return np.asarray(5.0 + np.where(yaw < 0.5, 1.0 - yaw, 2.0 * (yaw < 0.55)) + np.abs(yaw - 0.5))

    averages = Averages([[CIRCLE]], [[math.radians(20.0)]])
    found = search(step, [[CIRCLE]], [np.array([0.0])], averages=averages)
    assert found.cost >= float(step(0, np.zeros((1, 0)), found.values[0][None])[0])
