"""Displacements by turns agree with a fine integration of the motion, and with mirror images."""

import math

import numpy as np
import pytest

from ator_ros.bases.differential.durations import Rates, turn_time
from ator_ros.bases.differential.turns import (
    EDGE,
    ENTRIES,
    HALF,
    NODES,
    STEP,
    WEIGHTS,
    WIDEST,
    look_up,
    turn_end,
    turn_table,
    write_headings,
)

RATES = Rates(v=0.8, w=1.5, a=0.6, brake=0.7, aw=2.0)


def integrated(angle: float, rate: float, speed: float, change: float) -> tuple[float, float]:
    """Return the displacement in m by a turn, with 20,000 small steps."""
    ramp = min(math.sqrt(abs(angle) / RATES.aw), rate / RATES.aw)
    whole = turn_time(angle, rate, RATES.aw)
    steps = 20_000
    times = (np.arange(steps) + 0.5) * (whole / steps)
    rates = RATES.aw * np.minimum(np.minimum(times, whole - times), ramp)
    headings = np.cumsum(rates) * (whole / steps) - 0.5 * rates * (whole / steps)
    speeds = np.clip(speed + change * times, -RATES.v, RATES.v)
    x = float((speeds * np.cos(headings)).sum() * whole / steps)
    y = float((speeds * np.sin(headings)).sum() * whole / steps)
    return x, math.copysign(y, angle * speed) if y else y


def displacement(angle: float, rate: float, speed: float, change: float) -> tuple[float, float]:
    headings = np.empty((2, len(NODES)))
    time = write_headings(angle, rate, RATES.aw, headings)
    assert time == pytest.approx(turn_time(angle, rate, RATES.aw))
    x, y = turn_end(time, headings, speed, change, RATES.v)
    return x, y


def test_weights_integrate_polynomials_over_the_unit_interval() -> None:
    for power in range(8):
        assert (WEIGHTS * NODES**power).sum() == pytest.approx(1.0 / (power + 1))


@pytest.mark.parametrize("angle", [0.3, 1.2, 2.5, 4.0])
@pytest.mark.parametrize("rate", [0.6, 1.5])
@pytest.mark.parametrize(("speed", "change"), [(0.5, 0.0), (0.0, 0.3), (0.6, -0.2), (0.5, 0.4)])
def test_turns_lead_where_integration_does(
    angle: float, rate: float, speed: float, change: float
) -> None:
    expected = integrated(angle, rate, speed, change)
    assert displacement(angle, rate, speed, change) == pytest.approx(expected, abs=3e-3)


def test_a_turn_to_the_right_is_the_mirror_image_of_one_to_the_left() -> None:
    for angle in (0.2, 1.0, 3.0):
        x, y = displacement(angle, 1.0, 0.4, 0.1)
        assert displacement(-angle, 1.0, 0.4, 0.1) == pytest.approx((x, -y))
        assert displacement(angle, 1.0, -0.4, -0.1) == pytest.approx((-x, -y))


def test_tables_hold_displacements_along_and_across_the_drive() -> None:
    turns = np.array([[0.0, 0.0, 1.5], [0.4, 0.2, 1.5], [0.4, 0.2, 0.7], [-0.3, 0.0, 0.7]])
    table = turn_table(turns, RATES)
    assert table.along.shape == table.across.shape == (len(turns) * ENTRIES,)
    for row, (speed, change, rate) in enumerate(turns.tolist()):
        for angle in (-4.7, -2.0, -0.31, 0.0, 0.05, 1.0, 3.9):
            x, y = displacement(angle, rate, speed, change)
            cos, sin = math.cos(angle), math.sin(angle)
            time = turn_time(angle, rate, RATES.aw)
            along = look_up(table.along, row, angle) + speed * time
            across = look_up(table.across, row, angle)
            assert along == pytest.approx(cos * x + sin * y, abs=2e-4)
            assert across == pytest.approx(cos * y - sin * x, abs=2e-4)


def test_tables_reach_beyond_the_widest_turn_of_the_grid() -> None:
    assert HALF * STEP < WIDEST
    table = turn_table(np.array([[0.4, 0.0, 1.5]]), RATES)
    for angle in (-WIDEST, WIDEST):
        assert math.isfinite(look_up(table.across, 0, angle))
    assert table.across[EDGE] == 0.0
