"""Ranges of goal variables, of which a plan may allow parts."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ator_ros.tops.ranges import Interval, Range

CIRCLE = Range(-math.pi, math.pi, 36, periodic=True)
LINE = Range(-2.0, 2.0, 20, rest=0.0)

angles = st.floats(-2.0 * math.tau, 2.0 * math.tau, allow_subnormal=False)
widths = st.just(0.0) | st.floats(0.0, math.tau, allow_subnormal=False)
arcs = st.lists(st.builds(lambda low, width: (low, low + width), angles, widths), min_size=1)
few_arcs = arcs.map(lambda drawn: drawn[:4])


def in_arc(angle: float, arc: Interval, slack: float = 0.0) -> bool:
    behind_low = (angle - arc[0] + slack) % math.tau
    return arc[1] - arc[0] >= math.tau or behind_low <= arc[1] - arc[0] + 2.0 * slack


def apart(one: float, other: float) -> float:
    return abs(math.remainder(one - other, math.tau))


@settings(max_examples=40, deadline=None)
@given(few_arcs, angles)
def test_an_angle_is_contained_if_it_is_in_any_arc(intervals: list[Interval], angle: float) -> None:
    part = CIRCLE.within(intervals)
    assert part is not None
    if any(in_arc(angle, arc, -1e-7) for arc in intervals if arc[1] - arc[0] > 1e-6):
        assert part.contains(angle)
    if not any(in_arc(angle, arc, 1e-7) for arc in intervals):
        assert not part.contains(angle)


@settings(max_examples=40, deadline=None)
@given(few_arcs, angles)
def test_the_nearest_angle_is_allowed_and_no_end_is_nearer(
    intervals: list[Interval], angle: float
) -> None:
    part = CIRCLE.within(intervals)
    assert part is not None
    [nearest] = part.nearest(np.array([angle]))
    assert part.contains(nearest)
    if not part.contains(angle):
        ends = [end for arc in intervals for end in arc]
        assert apart(nearest, angle) == pytest.approx(
            min(apart(end, angle) for end in ends), abs=1e-7
        )


@settings(max_examples=40, deadline=None)
@given(few_arcs, st.integers(2, 60))
def test_grid_and_points_are_allowed_and_reach_each_arc(
    intervals: list[Interval], count: int
) -> None:
    part = CIRCLE.within(intervals)
    assert part is not None
    grid, step = part.grid(count)
    points = part.spread(np.linspace(0.0, 1.0, 20 * count))
    assert all(map(part.contains, (*grid, *points)))
    if part.parts:
        for arc in intervals:
            assert any(in_arc(value, arc, 1e-7) for value in grid)
        allowed = part.spread(np.random.default_rng(1).random(50))
        assert all(min(apart(one, value) for value in grid) <= step + 1e-7 for one in allowed)


@settings(max_examples=40, deadline=None)
@given(few_arcs, few_arcs, angles)
def test_a_part_of_a_part_is_in_both(
    first: list[Interval], second: list[Interval], angle: float
) -> None:
    one, other = CIRCLE.within(first), CIRCLE.within(second)
    assert one is not None
    assert other is not None
    both = one.within(second)
    if both is not None and both.contains(angle):
        for each in (one, other):  # up to rounding
            assert apart(angle, float(each.nearest(np.array([angle]))[0])) < 1e-7
    inside = all(any(in_arc(angle, arc, -1e-7) for arc in arcs) for arcs in (first, second))
    is_wide = all(high - low > 1e-6 for low, high in (*first, *second))
    if inside and is_wide:
        assert both is not None
        assert both.contains(angle)


def test_by_hand() -> None:
    """A station with a door at each side, up to 0.1 rad off."""
    sides = CIRCLE.within([(-0.1, 0.1), (math.pi - 0.1, math.pi + 0.1)])
    assert sides is not None
    assert sides.width == pytest.approx(0.4)
    assert all(map(sides.contains, (0.05, -3.1, 3.1, 3.0 * math.pi)))
    assert not any(map(sides.contains, (0.2, 1.5, math.nan)))
    nearest = sides.nearest(np.array([0.4, 3.0, -2.0]))
    assert nearest == pytest.approx([0.1, math.pi - 0.1, math.pi + 0.1])
    assert CIRCLE.within([(0.0, math.tau)]) == CIRCLE
    assert LINE.within([(1.0, 5.0)]) == Range(1.0, 2.0, 20, rest=1.0)
    assert LINE.within([(-5.0, -1.0), (0.5, 0.5)]) == Range(
        -2.0, 0.5, 20, rest=0.5, parts=((-2.0, -1.0), (0.5, 0.5))
    )
    assert LINE.within([(3.0, 4.0)]) is None
    assert str(LINE.within([(-5.0, -1.0), (0.5, 0.5)])) == "-2 to -1 or 0.5 to 0.5"
