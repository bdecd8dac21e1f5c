"""How near a robot comes to a place that it passes."""

import math

from hypothesis import given
from hypothesis import strategies as st

from ator_ros.world.closest_approach import ClosestApproach


def test_a_robot_leaves_a_place_once_it_is_clearly_farther_than_it_has_been() -> None:
    approach = ClosestApproach()
    assert approach.distance == math.inf
    left = [approach.leaves(distance) for distance in (2.0, 0.4, 0.3, 0.35, 0.45)]
    assert left == [False, False, False, False, True]
    assert approach.distance == 0.3


@given(st.lists(st.floats(0.0, 10.0), min_size=1))
def test_the_closest_approach_is_the_least_distance(distances: list[float]) -> None:
    approach = ClosestApproach()
    left = [approach.leaves(distance) for distance in distances]
    assert approach.distance == min(distances)
    assert not left[0]
