"""What the diagnostics say of a node's ticks (without ROS)."""

from __future__ import annotations

import pytest

from ator_ros.nodes.diagnostics import Ticks

NEWEST = "99 % of the last 1000 ticks within (ms)"


def test_before_the_first_tick_nothing_is_told() -> None:
    assert Ticks().told()[NEWEST] == "none yet"


def test_the_longest_tick_is_that_since_it_was_told_and_the_quantile_that_of_the_newest() -> None:
    ticks = Ticks()
    for number in range(2000):
        ticks.took(0.5 if number < 1000 else 0.001 * (1 + number % 100))
    told = ticks.told()
    assert told["longest tick (ms)"] == "500.0"
    assert float(str(told[NEWEST])) == pytest.approx(99.0, abs=0.5)
    again = ticks.told()
    assert again["longest tick (ms)"] == "0.0"
    assert again[NEWEST] == told[NEWEST]
