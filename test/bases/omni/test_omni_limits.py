"""Limits of an omnidirectional base in all directions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ator_ros.bases.omni.omni_limits import OmniLimits, extent, least_extent

ANGLES = st.floats(-7.0, 7.0)
AXES = st.tuples(*[st.floats(0.1, 5.0)] * 3)
SHAPES = st.booleans()


@given(AXES, ANGLES, SHAPES)
@settings(deadline=None)  # the first call compiles
def test_a_set_contains_its_half_axes_and_lies_within_its_box(
    axes: tuple[float, float, float], angle: float, box: bool
) -> None:
    front, back, side = axes
    found = extent(front, back, side, angle, box)
    assert min(axes) - 1e-9 <= found
    assert abs(found * math.sin(angle)) <= side + 1e-9
    assert -back - 1e-9 <= found * math.cos(angle) <= front + 1e-9
    for number, expected in enumerate((front, side, back, side)):
        at_axis = extent(front, back, side, number * math.pi / 2.0, box)
        assert at_axis == pytest.approx(expected)


@given(AXES, ANGLES)
@settings(deadline=None)  # the first call compiles
def test_a_box_contains_the_ellipse(axes: tuple[float, float, float], angle: float) -> None:
    assert extent(*axes, angle, True) >= extent(*axes, angle, False) - 1e-9


@given(AXES, ANGLES, ANGLES, SHAPES)
@settings(deadline=None)  # the first call compiles
def test_the_least_extent_is_that_of_some_heading_of_the_turn(
    axes: tuple[float, float, float], angle: float, turned: float, box: bool
) -> None:
    least = least_extent(*axes, angle, turned, box)
    passed = [
        extent(*axes, angle - share * turned, box) for share in np.linspace(0.0, 1.0, 201).tolist()
    ]
    assert least <= min(passed) + 1e-9
    assert least >= min(axes) - 1e-9
    if not box:  # a box has corners, at which samples miss the least by more
        assert least == pytest.approx(min(passed), rel=0.02)


def test_what_is_left_out_is_alike_in_all_directions() -> None:
    limits = OmniLimits(v=2.0, w=3.0, a=1.0, brake=1.5, aw=4.0)
    assert (limits.backward, limits.sideways, limits.side_change) == (2.0, 2.0, 1.0)
    given_all = OmniLimits(2.0, 3.0, 1.0, 1.5, 4.0, v_back=2.0, v_side=2.0, a_side=1.0)
    assert given_all == limits
    assert limits.scaled(0.5).speed_towards(2.0) == pytest.approx(1.0)


def test_scaled_limits_scale_all_axes() -> None:
    limits = OmniLimits(2.0, 3.0, 1.0, 1.5, 4.0, v_back=1.0, v_side=0.5, a_side=0.25, shape="box")
    half = limits.scaled(0.5)
    assert half.rates[:-1] == pytest.approx([0.5 * value for value in limits.rates[:-1]])
    assert half.shape == "box"
